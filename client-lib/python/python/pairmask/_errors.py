"""Errors of the library. Each class is one error enum of the Rust library, with its text."""


class PairmaskError(Exception):
    """Any error of this package that is no ValueError, TypeError or BufferError.

    `kind` is the name of the error in Rust: "TooManyFrames" of FrameError, for one.
    """

    kind: str

    def __init__(self, message: str = "", kind: str = "") -> None:
        super().__init__(message)
        self.kind = kind

    def __reduce__(self) -> tuple[type["PairmaskError"], tuple[str, str]]:
        return type(self), (str(self), self.kind)


class ConnectError(PairmaskError):
    """Why there is no session."""


class FrameError(PairmaskError):
    """Why there is no memory for a frame, or why it could not be submitted."""


class WaitError(PairmaskError):
    """Why a submitted frame has no answer."""


class WaitTimeout(WaitError, TimeoutError):
    """The time passed. The frame is still under way and may be awaited again."""


class CommitError(PairmaskError):
    """Why an edit of a scene has no answer."""


class FindError(PairmaskError):
    """Why a query of a scene has no answer."""


class SharedError(PairmaskError):
    """Why a shared scene was not joined, a lease not given, or a commit not answered."""


class StatusError(PairmaskError):
    """Why the daemon's status is not known."""
