//! What the bench of scenes that persist reports: rows, their picture, and the pace of its frames.

pub mod pace;
pub mod picture;
pub mod row;
