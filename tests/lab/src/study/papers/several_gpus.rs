//! Frames on more GPUs than were measured, simulated from the measured parts of one and of two.
//!
//! A frame on k GPUs takes what none of them can share, the k-th part of what they share, and the host's work for
//! each further one. Each reads all boxes over its own link, which is part of what they do not share; boxes that the
//! client writes slab by slab would be, which nothing does today.

use serde_json::{Value, json};

/// What a second GPU costs beside its share: another wait, and its submissions. Measured, `several-gpus.txt`.
const ANOTHER_GPU_MS: f64 = 0.035;
/// A link's bandwidth, bytes a millisecond: 54 GB/s, measured (`several-gpus.txt`).
const LINK_BYTES_A_MS: f64 = 54e6;
/// Bytes of a box.
const BOX_BYTES: f64 = 24.0;

/// A scene's round trips, ms, the middle ones of the runs.
#[derive(Clone, Debug, PartialEq)]
pub struct TwoGpus {
    /// The scene.
    pub scene: String,
    /// On one GPU.
    pub one_ms: f64,
    /// On two.
    pub two_ms: f64,
}

impl TwoGpus {
    /// One GPU's time over that of two.
    fn gain(&self) -> f64 {
        self.one_ms / self.two_ms
    }

    /// Time on so many GPUs, ms, where each reads all boxes, or, with `in_slabs`, its part of them.
    pub fn ms(&self, gpus: u32, in_slabs: bool) -> f64 {
        // A million boxes, but for the scene that is named by its number.
        let n = if self.scene == "ten million" { 1e7 } else { 1e6 };
        let reading = (n * BOX_BYTES / LINK_BYTES_A_MS).min(self.one_ms);
        // Two GPUs save half of what they share, and cost what another one costs.
        let saved = self.one_ms + ANOTHER_GPU_MS - self.two_ms;
        let shared = (2.0 * saved).clamp(0.0, self.one_ms - reading);
        let whole = self.one_ms - reading - shared;
        let k = f64::from(gpus);
        let reading = if in_slabs { reading / k } else { reading };
        reading + whole + shared / k + ANOTHER_GPU_MS * (k - 1.0)
    }
}

/// What the claims ask of the scene that gains most from a second GPU.
pub fn figures(scenes: &[TwoGpus]) -> Value {
    let Some(best) = scenes.iter().max_by(|a, b| a.gain().total_cmp(&b.gain())) else {
        return Value::Null;
    };
    json!({
        "of_scene": format!("{}, ", best.scene),
        "two_over_one": best.gain(),
        "four_over_one": best.ms(1, false) / best.ms(4, false),
        "four_over_one_in_slabs": best.ms(1, true) / best.ms(4, true),
        "eight_over_four": best.ms(4, false) / best.ms(8, false),
    })
}
