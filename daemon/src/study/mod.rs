//! Studies: measurements that settle a choice, apart from anything that serves a client.

pub mod engines;
pub mod mapping;
