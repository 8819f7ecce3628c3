//! Pairmask for C and C++: the facade of the crate `pairmask` behind a C ABI.
//!
//! `include/pairmask.h` documents each function and struct for programs, and is not repeated here. A test
//! compares its declarations with those of this crate. `include/pairmask.hpp` is the C++ interface on top.
//!
//! Objects live in a table (`handles`) and are named by ids with a generation: an id of a dropped object names
//! nothing, and using one in two threads at once is an error, not a race. Pointers are read
//! and written in one module (`memory`). Every function returns a code (`code`), and stores the text of the error for
//! its thread. A panic becomes a code.

// The names of engines are words.
#![allow(clippy::doc_markdown)]

#[macro_use]
mod memory;

mod call;
mod code;
mod failure;
mod filters;
mod frame;
mod handles;
#[cfg(test)]
mod header;
mod log_to;
mod mask;
mod scene;
mod session;
mod values;
