"""Errors of the library, with the texts that they have in Rust."""


class PairmaskError(Exception):
    """Any error of this package that is no ValueError, TypeError or BufferError.

    `kind` is the name of the error in Rust: "TooManyFrames", for one.
    """

    kind: str

    def __init__(self, message: str = "", kind: str = "") -> None:
        super().__init__(message)
        self.kind = kind

    def __reduce__(self) -> tuple[type["PairmaskError"], tuple[str, str]]:
        return type(self), (str(self), self.kind)


class ConnectError(PairmaskError):
    """Why there is no session."""


class WaitTimeout(PairmaskError, TimeoutError):
    """The time passed. The frame is still under way and may be awaited again."""
