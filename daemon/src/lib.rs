//! The pairmask daemon: ingest, execute, publish.

pub mod execute;
pub mod ingest;
pub mod publish;
pub mod serve;
