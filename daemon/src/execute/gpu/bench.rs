//! Measurements of the GPU engine.
