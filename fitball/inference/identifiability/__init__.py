"""What the data can tell: profiles, Fisher information, contraction, power-scaling, verdict."""
