"""The `guards` section and the reasons to end control: a row each."""
