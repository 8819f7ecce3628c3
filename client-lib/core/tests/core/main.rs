//! Scenes of the core and their exact pairs, as a user of the crate sees them.

mod margins;
mod scenes;
