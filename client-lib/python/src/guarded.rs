//! Objects of the library behind a lock, which Python's threads share, until they are closed or used up.

use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;
use pyo3::sync::MutexExt;

use crate::errors::misused;
use crate::process;

/// An object until it is closed or used up.
pub struct Guarded<T> {
    held: Mutex<Option<T>>,
    /// The text of the error after that.
    text: &'static str,
}

impl<T: Send> Guarded<T> {
    pub const fn new(object: T, text: &'static str) -> Self {
        Self { held: Mutex::new(Some(object)), text }
    }

    /// The lock, to be held shortly. Other Python threads run while this one waits for it.
    pub fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, Option<T>>> {
        process::check()?;
        self.held.lock_py_attached(py).map_err(|_| panicked())
    }

    /// What is raised where there is no object any more.
    pub fn closed(&self) -> PyErr {
        misused(self.text, "Closed")
    }

    /// Calls `f` with the object; other Python threads wait for its end, so that it has to be quick.
    pub fn with<R>(&self, py: Python<'_>, f: impl FnOnce(&mut T) -> R) -> PyResult<R> {
        self.lock(py)?.as_mut().map(f).ok_or_else(|| self.closed())
    }

    /// Calls `f` with what is there, while other Python threads run.
    fn detached<R: Send>(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut Option<T>) -> R + Send,
    ) -> PyResult<R> {
        process::check()?;
        py.detach(|| self.held.lock().map(|mut held| f(&mut held)).map_err(|_| panicked()))
    }

    /// Calls `f` with the object while other Python threads run.
    pub fn with_detached<R: Send>(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut T) -> R + Send,
    ) -> PyResult<R> {
        self.detached(py, |held| held.as_mut().map(f))?.ok_or_else(|| self.closed())
    }

    /// Calls `f` with the object, if it is still there, from a drop: other Python threads do not run meanwhile.
    /// In a forked process nothing happens.
    pub fn with_rest(&self, f: impl FnOnce(&mut T)) {
        if !process::is_forked()
            && let Ok(mut held) = self.held.lock()
            && let Some(object) = held.as_mut()
        {
            f(object);
        }
    }

    /// Takes the object out.
    pub fn take(&self, py: Python<'_>) -> PyResult<T> {
        self.lock(py)?.take().ok_or_else(|| self.closed())
    }

    /// Ends the object, if it is still there, while other Python threads run.
    pub fn close(&self, py: Python<'_>) -> PyResult<()> {
        let object = self.detached(py, Option::take)?;
        py.detach(|| drop(object));
        Ok(())
    }
}

impl<T> Drop for Guarded<T> {
    fn drop(&mut self) {
        process::drop_here(self.held.get_mut().unwrap_or_else(PoisonError::into_inner).take());
    }
}

fn panicked() -> PyErr {
    misused("an earlier call has panicked: this object cannot be used any more", "Panicked")
}
