"""RPG, recurrent policy gradients (chapter 3). Start with ``rpg.py``: the update is there."""
