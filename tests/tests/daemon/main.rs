//! Sessions and scenes of daemons that each test starts for itself.
#![allow(clippy::unwrap_used)]

mod ailing_daemons;
mod attacks;
mod budgets;
mod c_clients;
mod cancelled;
mod faults;
mod fences;
mod filtered_frames;
mod full_shm;
mod margined_scenes;
mod observers;
mod precision;
mod queries;
mod recordings;
mod repeats;
mod reply_limits;
mod saved_scenes;
mod scene_model;
mod scene_sessions;
mod scene_slots;
mod sessions;
mod shared_memory;
mod shared_scene_lives;
mod shared_scenes;
mod shifted_scenes;
mod side_by_side;
mod snapshots;
mod spheres;
mod strangers;
mod user_data;
