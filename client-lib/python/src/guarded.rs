//! Objects of the library behind a lock, which Python's threads share, and which may be gone.

use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;
use pyo3::sync::MutexExt;

use crate::errors::misused;
use crate::process;

/// An object until it is closed or used up.
pub struct Guarded<T> {
    held: Mutex<Option<T>>,
    /// What to say where it is gone.
    gone: &'static str,
}

impl<T> Guarded<T> {
    pub const fn new(object: T, gone: &'static str) -> Self {
        Self { held: Mutex::new(Some(object)), gone }
    }

    /// The lock. Other Python threads run while this one waits for it.
    fn lock<'a>(&'a self, py: Python<'_>) -> PyResult<MutexGuard<'a, Option<T>>>
    where
        T: Send,
    {
        process::check()?;
        self.held.lock_py_attached(py).map_err(|_| panicked())
    }

    /// Calls `f` with the object; other Python threads wait for its end, so that it has to be quick.
    pub fn with<R>(&self, py: Python<'_>, f: impl FnOnce(&mut T) -> R) -> PyResult<R>
    where
        T: Send,
    {
        let mut held = self.lock(py)?;
        held.as_mut().map(f).ok_or_else(|| misused(self.gone, "Gone"))
    }

    /// Calls `f` with the object while other Python threads run.
    pub fn with_detached<R: Send>(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut T) -> R + Send,
    ) -> PyResult<R>
    where
        T: Send,
    {
        process::check()?;
        let reported = py.detach(|| match self.held.lock() {
            Ok(mut held) => Ok(held.as_mut().map(f)),
            Err(_) => Err(()),
        });
        reported.map_err(|()| panicked())?.ok_or_else(|| misused(self.gone, "Gone"))
    }

    /// Calls `f` with the object, if it is still there, from a drop: no Python thread is told to run meanwhile.
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
    pub fn take(&self, py: Python<'_>) -> PyResult<T>
    where
        T: Send,
    {
        self.lock(py)?.take().ok_or_else(|| misused(self.gone, "Gone"))
    }

    /// Puts an object back.
    pub fn put(&self, py: Python<'_>, object: T) -> PyResult<()>
    where
        T: Send,
    {
        *self.lock(py)? = Some(object);
        Ok(())
    }

    /// Ends the object, if it is still there, while other Python threads run.
    pub fn close(&self, py: Python<'_>) -> PyResult<()>
    where
        T: Send,
    {
        process::check()?;
        py.detach(|| match self.held.lock() {
            Ok(mut held) => {
                let object = held.take();
                drop(held);
                drop(object);
                Ok(())
            }
            Err(_) => Err(()),
        })
        .map_err(|()| panicked())
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
