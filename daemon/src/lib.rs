//! The pairmask daemon: ingest, execute, publish; and the scenes that benches and tests share.

pub mod execute;
pub mod ingest;
pub mod publish;
pub mod scene;
pub mod serve;
