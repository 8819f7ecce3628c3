//! Errors of the library as exceptions of `pairmask._errors`, which have the library's text.

use std::fmt::{Debug, Display};

use pairmask::Error;
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

/// The classes as Python has them.
mod classes {
    use pyo3::import_exception;
    import_exception!(pairmask._errors, PairmaskError);
    import_exception!(pairmask._errors, ConnectError);
    import_exception!(pairmask._errors, WaitTimeout);
}

/// The text of an error, and the name of its variant in Rust.
fn reported<E: Display + Debug>(error: &E) -> (String, String) {
    let debug = format!("{error:?}");
    let end = debug.find(|c: char| !c.is_alphanumeric()).unwrap_or(debug.len());
    (error.to_string(), debug[..end].to_owned())
}

/// The exception of an error of the library.
pub fn raised(error: Error) -> PyErr {
    match error {
        Error::NoMemory { .. } => PyMemoryError::new_err(error.to_string()),
        Error::FilterData { .. } | Error::Listed { .. } => invalid(error),
        Error::Timeout { .. } => classes::WaitTimeout::new_err(reported(&error)),
        Error::Connect(error) => classes::ConnectError::new_err(reported(&error)),
        _ => classes::PairmaskError::new_err(reported(&error)),
    }
}

/// The exception of a value that is refused.
pub fn invalid(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// An error that Python alone knows: something is used after its end, or by two threads at a time.
pub fn misused(what: &'static str, kind: &'static str) -> PyErr {
    classes::PairmaskError::new_err((what, kind))
}
