//! Bridges in a simulation beside one big scene and beside the model, and their links over Zenoh.

mod bridges;
mod costs;
mod crossings;
mod links;
mod simulation;
