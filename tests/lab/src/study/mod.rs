//! Studies: measurements that settle a choice, apart from anything that serves a client.

pub mod accuracy;
pub mod engines;
pub mod grid;
pub mod machine;
pub mod mapping;
pub mod plot;
pub mod replies;
pub mod spheres;
