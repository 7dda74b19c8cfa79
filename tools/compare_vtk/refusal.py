"""How this tool ends early: with a sentence and an exit code, as the other tools do."""

ARGUMENTS, INPUT, MACHINE = 2, 3, 4


class Refusal(Exception):
    """What cannot be done, in one sentence with place, thing and remedy."""

    def __init__(self, code, message):
        super().__init__(message)
        self.code = code


class Said(Exception):
    """A program that was run has said why it failed."""

    def __init__(self, code):
        super().__init__(code)
        self.code = code
