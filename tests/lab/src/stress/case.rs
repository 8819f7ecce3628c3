//! One case: a seed, the scene that follows from it, and the truth.

use std::fmt::Write;
use std::ops::Range;
use std::sync::OnceLock;

use pairmask_core::Aabb;
use pairmask_core::oracle::{Truth, truth};
use pairmaskd::scene::{Random, Scene, SceneName};

use super::flags::MixedFlags;
use super::modes::{ModeCase, Usage};
use super::spheres::SphereCase;
use super::{changes, hard, scenes};

/// Largest case seed: 48 bits, so that it is exact as a number of JSON everywhere.
const CASE_SEED_BITS: u32 = 48;

/// Most pairs of a scene. A scene with more is halved until it has fewer: reading millions of bits
/// naively takes seconds and finds no more than reading thousands.
pub(super) const MOST_PAIRS: usize = 60_000;

/// Boxes of a large case. The oracle takes less than a second for the most.
const LARGE: Range<u64> = 5_000..12_000;

/// Makes the random numbers of large cases independent of those of others.
const LARGE_STREAM: u64 = 0x4c41_5247_4500;

#[derive(Clone, Debug)]
pub struct Case {
    pub seed: u64,
    pub is_large: bool,
    pub recipe: String,
    pub boxes: Vec<Aabb>,
    /// By the oracle, on a thread of the caller's flags.
    pub truth: Truth,
    pub flags: MixedFlags,
    spheres: OnceLock<SphereCase>,
    modes: [OnceLock<ModeCase>; Usage::ALL.len()],
}

impl Case {
    pub fn new(seed: u64) -> Self {
        Self::of_size(seed, false)
    }

    /// A case of a seed. A large one has thousands of boxes of an ordinary scene, enough work to be large for a daemon:
    /// hard scenes of that size have too many pairs for the oracle.
    pub fn of_size(seed: u64, is_large: bool) -> Self {
        let (mut boxes, recipe) = if is_large { large_scene(seed) } else { hard_scene(seed) };
        let flags = MixedFlags::of_seed(seed);
        let mut found = flags.caller.run(|| truth(&boxes));
        // One of too many pairs has the first of its boxes.
        while found.pairs.len() > MOST_PAIRS {
            boxes.truncate(boxes.len() / 2);
            found = flags.caller.run(|| truth(&boxes));
        }
        Self {
            seed,
            is_large,
            recipe,
            boxes,
            truth: found,
            flags,
            spheres: OnceLock::new(),
            modes: Default::default(),
        }
    }

    /// The spheres of the same seed, made on first use, because their truth takes long.
    pub fn spheres(&self) -> &SphereCase {
        self.spheres.get_or_init(|| SphereCase::new(self.seed))
    }

    pub fn in_mode(&self, usage: Usage) -> &ModeCase {
        self.modes[usage as usize]
            .get_or_init(|| ModeCase::new(self.seed, &self.boxes, usage, &self.flags))
    }

    pub fn next_seed(run: &mut Random) -> u64 {
        run.bits() >> (u64::BITS - CASE_SEED_BITS)
    }
}

fn large_scene(seed: u64) -> (Vec<Aabb>, String) {
    let mut random = Random::new(seed ^ LARGE_STREAM);
    let n = LARGE.start + random.below(LARGE.end - LARGE.start);
    let names: Vec<SceneName> =
        SceneName::ALL.into_iter().filter(|name| !name.is_quadratic()).collect();
    let name = names[random.below(names.len() as u64) as usize];
    let scene = Scene::new(name, n as usize, random.bits());
    (scene.boxes().to_vec(), format!("{name}, a large one"))
}

fn hard_scene(seed: u64) -> (Vec<Aabb>, String) {
    let random = &mut Random::new(seed);
    let n = box_count(random);
    let (mut boxes, mut recipe) = match random.below(5) {
        0 => {
            let (mut boxes, first) = draw(n / 2, random);
            let (rest, second) = draw(n - n / 2, random);
            boxes.extend(rest);
            (boxes, format!("{first}, then {second}"))
        }
        1 => {
            let ((mut boxes, first), (other, second)) = (draw(n, random), draw(n, random));
            for (one, another) in boxes.iter_mut().zip(other) {
                if random.below(3) == 0 {
                    *one = another;
                }
            }
            (boxes, format!("{first} mixed with {second}"))
        }
        _ => {
            let (boxes, name) = draw(n, random);
            (boxes, name.to_owned())
        }
    };
    for _ in 0..random.below(4) {
        let (name, apply) = changes::ALL[random.below(changes::ALL.len() as u64) as usize];
        apply(&mut boxes, random);
        // Writing to a string cannot fail.
        let _ = write!(recipe, ", {name}");
    }
    (boxes, recipe)
}

/// Number of boxes: few, or near a power of two, or near a multiple of the engines' units (strips
/// of 16, words of 32, groups of 64 to 256, tasks of 1,024).
fn box_count(random: &mut Random) -> usize {
    let beside = |n: u64, random: &mut Random| (n + random.below(5)).saturating_sub(2) as usize;
    match random.below(20) {
        0..8 => random.below(71) as usize,
        8..13 => {
            let power = 1 << random.below(11);
            beside(power, random)
        }
        13..18 => {
            let unit = [16, 32, 48, 64, 96, 128, 192, 256][random.below(8) as usize];
            let count = 1 + random.below(1 + 1_200 / unit);
            beside(count * unit, random)
        }
        18 => 70 + random.below(1_400) as usize,
        _ => {
            let many = [1_536, 2_048, 2_304, 3_072, 4_096][random.below(5) as usize];
            beside(many, random)
        }
    }
}

fn draw(n: usize, random: &mut Random) -> (Vec<Aabb>, &'static str) {
    let (plain, hard) = (scenes::ALL.len(), hard::ALL.len());
    let which = random.below((plain + hard) as u64) as usize;
    if let Some(scene) = scenes::ALL.get(which) {
        return (scene.boxes(n as u32, random.bits()), scene.name());
    }
    let (name, make) = hard::ALL[which - plain];
    (make(n, random), name)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn sizes_lie_around_the_borders_of_engines() {
        let mut random = Random::new(2);
        let sizes: BTreeSet<usize> = (0..4_000).map(|_| box_count(&mut random)).collect();
        for n in [0, 1, 2, 31, 32, 33, 63, 64, 65, 255, 256, 257, 511, 512, 513, 1023, 1024, 1025] {
            assert!(sizes.contains(&n), "{n} boxes were never drawn");
        }
        assert!(sizes.iter().any(|&n| n > 2_048), "nothing that is worth a second thread");
    }
}
