//! How a claim of a paper stands today.

use std::fmt;

use serde::Serialize;

/// Whether a claim holds here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All its figures are there, and it holds in all of them.
    Holds,
    /// It fails in some figure.
    Breaks,
    /// A figure is missing, and it fails in none of the others.
    NotMeasured,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Holds => "holds",
            Self::Breaks => "breaks",
            Self::NotMeasured => "not measured",
        })
    }
}
