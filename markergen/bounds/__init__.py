"""What a layout can tell at best: the information of its dots, and what could be taken for it."""
