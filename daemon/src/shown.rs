//! What a command shows: a JSON object, or the same as text.

use std::fmt;

use serde::Serialize;
use serde_json::Value;

/// A JSON object, whose fields `CLI.md` explains, and the same as text. Fields may be added, never changed or taken
/// away.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Shown {
    pub fields: Value,
    #[serde(skip)]
    pub text: String,
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}
