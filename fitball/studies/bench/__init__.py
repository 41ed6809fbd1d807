"""Speed against error; hard cases."""
