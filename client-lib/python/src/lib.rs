//! The Python client of Pairmask: the package `pairmask` over the Rust library.
//!
//! Each class of Python holds an object of the library behind a lock, and calls it without the interpreter's
//! lock. Names, answers and texts of errors are the library's. The package's README lists what differs.
// Python's objects come to methods by value, many of them by name, and methods of classes take `self` by convention.
#![allow(clippy::needless_pass_by_value, clippy::too_many_arguments, clippy::unused_self)]

/// A function or class of Python, which is looked up once.
macro_rules! imported {
    ($py:expr, $module:literal, $name:literal) => {{
        static FOUND: pyo3::sync::PyOnceLock<pyo3::Py<pyo3::PyAny>> = pyo3::sync::PyOnceLock::new();
        FOUND.import($py, $module, $name)
    }};
}

mod arrays;
mod boxes;
mod engines;
mod errors;
mod frame;
mod guarded;
mod memory;
mod pairs;
mod precision;
mod process;
mod rules;
mod scene;
mod session;

/// The extension module.
#[pyo3::pymodule]
mod _pairmask {
    /// The version of the package.
    #[pymodule_export]
    #[allow(non_upper_case_globals)] // The name is Python's.
    const __version__: &str = env!("CARGO_PKG_VERSION");
    #[pymodule_export]
    use crate::{
        boxes::{outward_from_f64, placed, points, spheres_from_f64, swept, swept_by, transformed},
        engines::{
            from_avian, from_box2d, from_bullet, from_jolt_mask, from_mujoco, from_newton,
            from_physx_words, from_rapier, owner_of,
        },
        frame::{PyFrame, PyPendingFrame},
        pairs::PyPairMask,
        precision::PyPrecision,
        rules::{PyFilter, PyFilterTable, PyRules},
        scene::{PyEdit, PyPendingAnswer, PyScene},
        session::PySession,
    };
}
