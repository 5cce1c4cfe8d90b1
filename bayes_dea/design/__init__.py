"""Which experiment to run next: what each one of the menu is expected to teach, and what it costs."""
