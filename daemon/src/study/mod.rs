//! Studies: measurements that settle a choice, apart from anything that serves a client.

pub mod grid;
pub mod mapping;
