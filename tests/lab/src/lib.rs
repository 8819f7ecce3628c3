//! The laboratory of pairmask: measurements that settle a choice, and engines put to the test.
//! Nothing that serves a client depends on it.
//!
//! ```text
//! study       measurements beside the papers' figures, one folder a question
//! gpu_stages  the GPU engines' stages, by the GPU's clock
//! stress      hard scenes, every engine and mode against the oracle
//! sabotage    engines broken on purpose, to see that all of it notices
//! cli         the binary `pairmask-lab`
//! ```

pub mod cli;
pub mod gpu_stages;
pub mod sabotage;
pub mod stress;
pub mod study;
