//! Errors of the library as exceptions of `pairmask._errors`, which have the library's text.

use std::fmt::{Debug, Display};

use pairmask::{ConnectError, Error};
use pairmask_core::engine::UnknownName;
use pairmask_core::precision::{BoundsError, MarginError};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

/// The classes as Python has them.
mod classes {
    use pyo3::import_exception;
    import_exception!(pairmask._errors, PairmaskError);
    import_exception!(pairmask._errors, ConnectError);
    import_exception!(pairmask._errors, WaitTimeout);
}

/// An error of the library that has an exception.
pub trait Raise {
    /// The exception.
    fn raise(self) -> PyErr;
}

/// The text of an error, and the name of its variant in Rust.
fn reported<E: Display + Debug>(error: &E) -> (String, String) {
    let debug = format!("{error:?}");
    let end = debug.find(|c: char| !c.is_alphanumeric()).unwrap_or(debug.len());
    (error.to_string(), debug[..end].to_owned())
}

impl Raise for ConnectError {
    fn raise(self) -> PyErr {
        classes::ConnectError::new_err(reported(&self))
    }
}

impl Raise for Error {
    fn raise(self) -> PyErr {
        match self {
            Self::NoMemory { .. } => PyMemoryError::new_err(self.to_string()),
            Self::Tags { .. } | Self::Listed { .. } => PyValueError::new_err(self.to_string()),
            Self::Timeout { .. } => classes::WaitTimeout::new_err(reported(&self)),
            Self::Connect(error) => error.raise(),
            _ => classes::PairmaskError::new_err(reported(&self)),
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
