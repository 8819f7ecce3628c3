//! Joins the shared scenes of several machines.
//!
//! ```text
//! ids, state, space, view   names of boxes, what a box is, slabs and their owners, who takes part
//! protocol                  messages, byte by byte
//! stream                    batches in their order over a network that loses, doubles and reorders messages
//! replica                   boxes of all machines as of one tick, and the pairs between machines
//! session                   the streams and the replica of one view
//! node                      one bridge, without effects: inputs are boxes, messages and instants
//! model                     what a scene costs on paper
//!
//! member, zenoh_link        effects: the local shared scene, the network
//! bridge                    a node between both
//! ```

pub mod bridge;
pub mod ids;
pub mod member;
pub mod model;
pub mod node;
pub mod protocol;
mod replica;
mod session;
pub mod space;
pub mod state;
mod stream;
pub mod view;
pub mod zenoh_link;
