"""What users write and what lies in result folders, damaged at random: every command must end in exit 0 or 2."""
