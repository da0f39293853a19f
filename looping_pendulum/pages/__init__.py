"""What every HTML page of this project shares: its shell, its palette, its tables and figures. Knows no physics."""
