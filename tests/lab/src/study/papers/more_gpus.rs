//! Frames on more GPUs than were measured, simulated from the measured parts of one and of two.
//!
//! A frame on k GPUs takes what none of them can share, the k-th part of what they share, and the host's work for
//! each further one. Each reads all boxes over its own link, which is part of what they do not share; boxes that the
//! client writes slab by slab would be, which nothing does today.

use super::shapes::TwoGpus;

/// What a second GPU costs beside its share: another wait, and its submissions. Measured, `several-gpus.txt`.
const ANOTHER_GPU_MS: f64 = 0.035;
/// A link's bandwidth, bytes a millisecond: 54 GB/s, measured (`several-gpus.txt`).
const LINK_BYTES_A_MS: f64 = 54e6;
/// Bytes of a box.
const BOX_BYTES: f64 = 24.0;

/// The parts of a frame, ms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts {
    /// Reading all boxes over a link.
    reading: f64,
    /// What else each GPU, or the host, does in full.
    whole: f64,
    /// What GPUs share.
    shared: f64,
}

/// Who reads the boxes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// Each GPU all of them: as it is.
    All,
    /// Each GPU its part: as if they were written slab by slab.
    Slabs,
}

impl Parts {
    /// The parts of a scene of `n` boxes, from its times on one GPU and on two.
    pub fn of(scene: &TwoGpus, n: u32) -> Self {
        let reading = (f64::from(n) * BOX_BYTES / LINK_BYTES_A_MS).min(scene.one_ms);
        // Two GPUs save half of what they share, and cost what another one costs.
        let saved = scene.one_ms + ANOTHER_GPU_MS - scene.two_ms;
        let shared = (2.0 * saved).clamp(0.0, scene.one_ms - reading);
        Self { reading, whole: scene.one_ms - reading - shared, shared }
    }

    /// Time on so many GPUs, ms.
    pub fn ms(&self, gpus: u32, reading: Reading) -> f64 {
        let k = f64::from(gpus);
        let reading = match reading {
            Reading::All => self.reading,
            Reading::Slabs => self.reading / k,
        };
        reading + self.whole + self.shared / k + ANOTHER_GPU_MS * (k - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(one_ms: f64, two_ms: f64) -> TwoGpus {
        TwoGpus { scene: "s".into(), one_ms, two_ms }
    }

    #[test]
    fn one_gpu_and_two_take_what_was_measured() {
        let parts = Parts::of(&scene(1.659, 1.2), 1_000_000);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} for {b}");
        near(parts.ms(1, Reading::All), 1.659);
        near(parts.ms(2, Reading::All), 1.2);
        near(parts.ms(1, Reading::Slabs), 1.659);
        // 24 MB at 54 GB/s.
        near(parts.ms(2, Reading::All) - parts.ms(2, Reading::Slabs), 0.5 * 24.0 / 54.0);
    }

    #[test]
    fn no_more_is_shared_than_there_is_and_no_less_than_nothing() {
        let slower = Parts::of(&scene(1.0, 1.5), 1_000_000);
        assert!(slower.shared.abs() < f64::EPSILON && slower.ms(8, Reading::All) > 1.0);
        let all = Parts::of(&scene(1.0, 0.1), 1_000_000);
        assert!(all.whole.abs() < 1e-12 && all.ms(4, Reading::All) > 24.0 / 54.0);
        // Reading alone takes longer than the frame: then that is all there is.
        let short = Parts::of(&scene(0.1, 0.1), 1_000_000);
        assert!((short.ms(1, Reading::All) - 0.1).abs() < 1e-12);
    }
}
