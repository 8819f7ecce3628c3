//! The mapping function study.
pub mod errors;
pub mod mirror;
pub mod root_errors;
pub mod roots;
