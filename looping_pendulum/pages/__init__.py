"""What every HTML page of this project shares: its shell, its palette, its tables and figures. Knows no physics.

A page is one file that works offline: styles, scripts and data stand in it, and its own security policy allows no request.
Every text is escaped on its way in (Jinja2's autoescape, `markdown.html`, `shell.embedded`), so a hostile name shows as text.
"""
