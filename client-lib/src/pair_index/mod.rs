//! The pair index.
