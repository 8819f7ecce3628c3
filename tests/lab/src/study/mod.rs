//! Studies: measurements on which choices rest. No code that serves a client depends on them.

pub mod accuracy;
pub mod grid;
pub mod judge;
pub mod machine;
pub mod mapping;
pub mod moving;
pub mod papers;
pub mod spheres;
pub mod stage_bench;
pub mod sweep;
pub mod threads;
pub mod updates;
pub mod verdict;
pub mod ways;
