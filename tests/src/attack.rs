//! How long an attack is repeated.

use std::time::Duration;

/// Environment variable that says for how many seconds each attack goes on.
const SECONDS_VARIABLE: &str = "PAIRMASK_ATTACK_SECONDS";

/// Long enough for dozens of rounds of every attack, short enough for each change's test run.
const QUICK: Duration = Duration::from_secs(2);

/// How long a test repeats its attack: two seconds, or what `PAIRMASK_ATTACK_SECONDS` says. The
/// nightly run sets 300.
///
/// # Panics
/// When the variable is set to something that is no whole number of seconds: a nightly run that
/// falls back to two seconds would pass unseen.
pub fn attack_time() -> Duration {
    std::env::var(SECONDS_VARIABLE).map_or(QUICK, |text| match text.parse() {
        Ok(seconds) => Duration::from_secs(seconds),
        Err(error) => panic!("{SECONDS_VARIABLE}={text}: {error}"),
    })
}
