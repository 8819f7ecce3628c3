//! The share of the frames that the auditor checks.

use std::fmt;
use std::num::NonZeroU32;
use std::str::FromStr;

/// No frame, or one in N, drawn at random.
///
/// ```
/// use pairmaskd::audit::AuditRate;
/// assert_eq!("1/1000".parse::<AuditRate>().map(|rate| rate.to_string()), Ok("1/1000".into()));
/// assert!("2/3".parse::<AuditRate>().is_err());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AuditRate {
    /// None.
    #[default]
    Off,
    /// One in N.
    OneIn(NonZeroU32),
}

/// The text is no rate.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is no rate of audits: write 1/1000 for one frame in a thousand, or off")]
pub struct BadRate(String);

impl FromStr for AuditRate {
    type Err = BadRate;

    fn from_str(s: &str) -> Result<Self, BadRate> {
        if s == "off" {
            return Ok(Self::Off);
        }
        let one_in = s.strip_prefix("1/").and_then(|n| n.parse().ok());
        one_in.map(Self::OneIn).ok_or_else(|| BadRate(s.to_owned()))
    }
}

impl fmt::Display for AuditRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::OneIn(n) => write!(f, "1/{n}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_parse_back_and_others_are_refused() {
        for text in ["off", "1/1", "1/1000"] {
            assert_eq!(text.parse::<AuditRate>().map(|rate| rate.to_string()).as_deref(), Ok(text));
        }
        for text in ["", "1/0", "2/3", "0.1", "1/", "1/-4"] {
            assert!(text.parse::<AuditRate>().is_err(), "{text}");
        }
    }
}
