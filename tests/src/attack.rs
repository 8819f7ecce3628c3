//! The time for which tests repeat an attack.

use std::time::Duration;

/// Environment variable with the time of each attack in seconds.
const SECONDS_VARIABLE: &str = "PAIRMASK_ATTACK_SECONDS";

/// Long enough for dozens of rounds of every attack, short enough for each change's test run.
const QUICK: Duration = Duration::from_secs(2);

/// The time for which a test repeats its attack: two seconds, or `PAIRMASK_ATTACK_SECONDS`. The
/// nightly run sets 300.
///
/// # Panics
/// When the variable is no whole number of seconds: otherwise a nightly run could fall back to two
/// seconds unnoticed.
pub fn attack_time() -> Duration {
    std::env::var(SECONDS_VARIABLE).map_or(QUICK, |text| match text.parse() {
        Ok(seconds) => Duration::from_secs(seconds),
        Err(error) => panic!("{SECONDS_VARIABLE}={text}: {error}"),
    })
}
