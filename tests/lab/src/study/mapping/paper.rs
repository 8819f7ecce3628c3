//! The paper's own figures (Avril et al. 2012; Quadro FX 3600M, Core 2 Duo X7900).

use crate::study::mapping::stage::{Magic, PairOutput, Root, Steps};

/// Table 2: ms with a square root and the lazy way.
pub fn table_2(n: u32) -> Option<(f64, f64)> {
    match n {
        1_000 => Some((0.21, 0.25)),
        10_000 => Some((2.25, 4.28)),
        100_000 => Some((29.66, 58.24)),
        _ => None,
    }
}

/// Table 3: percent of integer parts that are wrong.
pub fn table_3(root: Root, count: u64) -> Option<f64> {
    let Root::Newton(magic, steps) = root else { return None };
    // "The percentage of error with 4 accuracy steps is exactly the same than the 3 step's one."
    let (carmack, lomont) = match (steps, count) {
        (Steps::Two, 1_000) => (2.9, 2.9),
        (Steps::Two, 10_000) => (0.89, 0.89),
        (Steps::Two, 100_000) => (0.27, 0.27),
        (Steps::Two, 1_000_000) => (0.18, 0.1803),
        (Steps::Two, 10_000_000) => (0.3681, 0.3685),
        (Steps::Two, 100_000_000) => (0.9847, 0.9855),
        (Steps::Three | Steps::Four, 1_000) => (0.7, 0.7),
        (Steps::Three | Steps::Four, 10_000) => (0.12, 0.12),
        (Steps::Three | Steps::Four, 100_000) => (0.035, 0.035),
        (Steps::Three | Steps::Four, 1_000_000) => (0.011, 0.0111),
        (Steps::Three | Steps::Four, 10_000_000) => (0.004, 0.0057),
        (Steps::Three | Steps::Four, 100_000_000) => (0.0134, 0.0142),
        _ => return None,
    };
    Some(match magic {
        Magic::Carmack => carmack,
        Magic::Lomont => lomont,
    })
}

/// Table 4: ms for so many roots. The paper does not say how many steps; its code has one.
pub fn table_4(root: Root, count: u64) -> Option<f64> {
    let (newton, built_in) = match count {
        1_000_000 => (0.042, 0.048),
        10_000_000 => (0.409, 0.478),
        100_000_000 => (4.102, 4.722),
        1_000_000_000 => (41.01, 48.01),
        _ => return None,
    };
    Some(if root == Root::BuiltIn { built_in } else { newton })
}

/// Table 5: kernel in ms and transfer in µs.
pub fn table_5(output: PairOutput, n: u32) -> Option<(f64, f64)> {
    match (output, n) {
        (PairOutput::Byte, 100) => Some((0.03, 14.35)),
        (PairOutput::Byte, 1_000) => Some((2.70, 842.75)),
        (PairOutput::Byte, 5_000) => Some((73.95, 21_428.0)),
        (PairOutput::Byte, 7_500) => Some((163.60, 45_865.94)),
        (PairOutput::Bit, 100) => Some((0.03, 7.75)),
        (PairOutput::Bit, 1_000) => Some((2.72, 111.18)),
        (PairOutput::Bit, 5_000) => Some((74.14, 2_612.42)),
        (PairOutput::Bit, 7_500) => Some((162.03, 5_687.20)),
        _ => None,
    }
}
