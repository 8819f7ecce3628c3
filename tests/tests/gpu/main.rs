//! All that a GPU computes, on lavapipe or on the GPUs that `PAIRMASK_TEST_GPU` names; fails without an adapter.
#![allow(clippy::unwrap_used)]

mod bundles;
mod cancelled;
mod crowds;
mod daemon;
mod forms;
mod grid;
mod import;
mod loss;
mod masks;
mod rules;
mod scene_casts;
mod scene_loss;
mod scene_queries;
mod scenes;
mod several_gpus;
mod spheres;
mod under_way;
