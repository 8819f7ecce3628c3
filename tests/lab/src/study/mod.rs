//! Studies: measurements that settle a choice, apart from anything that serves a client.

pub mod accuracy;
pub mod grid;
pub mod judge;
pub mod machine;
pub mod mapping;
pub mod plot;
pub mod spheres;
pub mod updates;
