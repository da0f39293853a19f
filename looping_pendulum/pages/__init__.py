"""Parts that all reports and pages of this project share: figures as data, shell, palette, number formats. No physics.

A page is one file that works offline: it embeds styles, scripts and data, and its security policy allows no requests. Every
text is escaped (Jinja2's autoescape, `markdown.html`, `shell.embedded`), so that a hostile name is shown as text.
"""
