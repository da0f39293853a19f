"""The verdict as Markdown, page, figures and files."""
