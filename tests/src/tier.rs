//! How much a test run is to prove: what every change needs, or what a night has time for.

use std::time::Duration;

/// Whether this is the nightly tier, which runs every size: `PAIRMASK_TIER=nightly`.
pub fn is_nightly() -> bool {
    std::env::var("PAIRMASK_TIER").is_ok_and(|tier| tier == "nightly")
}

/// Sizes up to 70: all of them in the nightly tier, else those beside the borders of words and groups, and a few between.
pub fn small_sizes() -> Vec<u32> {
    if is_nightly() {
        (0..=70).collect()
    } else {
        vec![0, 1, 2, 3, 7, 31, 32, 33, 50, 63, 64, 65, 70]
    }
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
