//! Errors of the library as exceptions of `pairmask._errors`, which have the library's text.

use std::error::Error;
use std::fmt::Debug;

use pairmask::error::{BoundsError, MarginError, UnknownName};
use pairmask::{
    CommitError, ConnectError, FindError, FrameError, SharedError, StatusError, WaitError,
};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

/// The classes as Python has them.
mod classes {
    use pyo3::import_exception;
    import_exception!(pairmask._errors, PairmaskError);
    import_exception!(pairmask._errors, ConnectError);
    import_exception!(pairmask._errors, FrameError);
    import_exception!(pairmask._errors, WaitError);
    import_exception!(pairmask._errors, WaitTimeout);
    import_exception!(pairmask._errors, CommitError);
    import_exception!(pairmask._errors, FindError);
    import_exception!(pairmask._errors, SharedError);
    import_exception!(pairmask._errors, StatusError);
}

/// An error of the library that has an exception.
pub trait Raise {
    /// The exception.
    fn raise(self) -> PyErr;
}

/// The text of an error, and the name of its variant in Rust.
fn reported<E: Error + Debug>(error: &E) -> (String, String) {
    let debug = format!("{error:?}");
    let end = debug.find(|c: char| !c.is_alphanumeric()).unwrap_or(debug.len());
    (error.to_string(), debug[..end].to_owned())
}

macro_rules! raise {
    ($($error:ident),* $(,)?) => {
        $(
            impl Raise for $error {
                fn raise(self) -> PyErr {
                    classes::$error::new_err(reported(&self))
                }
            }
        )*
    };
}
raise!(ConnectError, FindError, SharedError, StatusError);

impl Raise for CommitError {
    fn raise(self) -> PyErr {
        match self {
            Self::Shared(error) => error.raise(),
            _ => classes::CommitError::new_err(reported(&self)),
        }
    }
}

impl Raise for FrameError {
    fn raise(self) -> PyErr {
        match self {
            Self::NoMemory { .. } => PyMemoryError::new_err(self.to_string()),
            _ => classes::FrameError::new_err(reported(&self)),
        }
    }
}

impl Raise for WaitError {
    fn raise(self) -> PyErr {
        match self {
            Self::Timeout { .. } => classes::WaitTimeout::new_err(reported(&self)),
            _ => classes::WaitError::new_err(reported(&self)),
        }
    }
}

macro_rules! raise_value {
    ($($error:ident),* $(,)?) => {
        $(
            impl Raise for $error {
                fn raise(self) -> PyErr {
                    PyValueError::new_err(self.to_string())
                }
            }
        )*
    };
}
raise_value!(BoundsError, MarginError, UnknownName);

/// An error that Python alone knows: something is used after its end, or by two threads at a time.
pub fn misused(what: &'static str, kind: &'static str) -> PyErr {
    classes::PairmaskError::new_err((what, kind))
}
