"""The command line: `main.py` finds the verb, each verb is one thin module beside it."""
