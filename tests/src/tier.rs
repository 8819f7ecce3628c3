//! How much a test run is to prove: what every change needs, or what a night has time for.

use std::time::Duration;

/// Whether this is the nightly tier, which runs every size: `PAIRMASK_TIER=nightly`.
pub fn is_nightly() -> bool {
    std::env::var("PAIRMASK_TIER").is_ok_and(|tier| tier == "nightly")
}

/// What a night has time for, or what every change needs.
pub fn nightly_or<T>(nightly: T, usual: T) -> T {
    if is_nightly() { nightly } else { usual }
}

/// Sizes up to 70: all of them in the nightly tier, else those beside the borders of words and groups, and a few between.
pub fn small_sizes() -> Vec<u32> {
    nightly_or((0..=70).collect(), vec![0, 1, 2, 3, 7, 31, 32, 33, 50, 63, 64, 65, 70])
}

/// The time for which a test repeats its attack: two seconds, or `PAIRMASK_ATTACK_SECONDS`; the nightly run sets 300.
pub fn attack_time() -> Duration {
    std::env::var("PAIRMASK_ATTACK_SECONDS").map_or(Duration::from_secs(2), |text| {
        match text.parse() {
            Ok(seconds) => Duration::from_secs(seconds),
            Err(error) => panic!("PAIRMASK_ATTACK_SECONDS={text}: {error}"),
        }
    })
}
