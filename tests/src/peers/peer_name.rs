//! The peers by name.

use std::fmt;
use std::str::FromStr;

use pairmask_core::engine::UnknownName;

/// A library, and one way of its users to keep it up to date.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PeerName {
    /// parry3d's tree, refitted each frame.
    ParryRefit,
    /// parry3d's tree, a few subtrees built anew each frame, then refitted.
    ParryOptimize,
    /// parry3d's tree, built anew each frame.
    ParryRebuild,
    /// rapier3d's broad phase.
    Rapier,
    /// obvhs's tree, refitted each frame.
    ObvhsRefit,
    /// obvhs's tree, built anew each frame (PLOC).
    ObvhsRebuild,
    /// rstar's tree, bulk-loaded each frame.
    Rstar,
}

impl PeerName {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::ParryRefit,
        Self::ParryOptimize,
        Self::ParryRebuild,
        Self::Rapier,
        Self::ObvhsRefit,
        Self::ObvhsRebuild,
        Self::Rstar,
    ];

    /// The name on the command line and in tables.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::ParryRefit => "parry-refit",
            Self::ParryOptimize => "parry-optimize",
            Self::ParryRebuild => "parry-rebuild",
            Self::Rapier => "rapier",
            Self::ObvhsRefit => "obvhs-refit",
            Self::ObvhsRebuild => "obvhs-rebuild",
            Self::Rstar => "rstar",
        }
    }
}

impl fmt::Display for PeerName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl FromStr for PeerName {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        Self::ALL.into_iter().find(|name| name.as_str() == s).ok_or_else(|| UnknownName {
            name: s.to_owned(),
            known: "parry-refit, parry-optimize, parry-rebuild, rapier, obvhs-refit, obvhs-rebuild, rstar".into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back_and_errors_list_them_all() {
        let error = "nobody".parse::<PeerName>().map_err(|e| e.to_string());
        let Err(text) = error else { panic!("an unknown name must not parse") };
        for name in PeerName::ALL {
            assert_eq!(name.to_string().parse::<PeerName>().ok(), Some(name));
            assert!(text.contains(name.as_str()), "{text} lacks {name}");
        }
    }
}
