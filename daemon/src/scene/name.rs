//! The scenes by name. The names are part of the command line's contract.

use std::fmt;
use std::str::FromStr;

use pairmask_core::engine::UnknownName;

/// A kind of scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SceneName {
    /// Edges 0.8 to 1.2 in a cube, about 1 pair a box.
    Uniform,
    /// Edges log-uniform from 0.01 to 10, about 2 pairs a box.
    Mixed,
    /// A heap of radius 4 × height in a jittered brick lattice, about 7 pairs a box.
    Pile,
    /// Every z overlaps; Gaussian blobs of 2,000 boxes, about 3 pairs a box.
    Plane,
    /// Falling columns of turned cubes (papers 2009 to 2014).
    Cubes,
    /// Falling columns of balls (papers 2009 to 2014).
    Balls,
    /// Falling columns of skittles: tall and thin, turned (papers 2009 to 2014).
    Skittles,
    /// Falling columns of tori: wide and flat, turned (paper 2014).
    Torus,
    /// Falling columns of letters: unlike objects (paper 2014).
    Letters,
    /// A uniform scene, and eight boxes so far off that a grid over the bounds has one full cell.
    OneCell,
    /// Thin rods, 40 times as long as wide, along any axis.
    Rods,
    /// Dust, a few huge boxes, an infinite ground and one box that covers everything.
    Giants,
    /// A uniform scene where a float's step is up to a sixteenth of a box.
    Far,
    /// All boxes the same: every pair overlaps, n(n − 1)/2 of them.
    Identical,
}

impl SceneName {
    /// Every scene: the four of the anchors, the papers' five, the worst cases.
    pub const ALL: [Self; 14] = [
        Self::Uniform,
        Self::Mixed,
        Self::Pile,
        Self::Plane,
        Self::Cubes,
        Self::Balls,
        Self::Skittles,
        Self::Torus,
        Self::Letters,
        Self::OneCell,
        Self::Rods,
        Self::Giants,
        Self::Far,
        Self::Identical,
    ];

    /// The name on the command line and in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Mixed => "mixed",
            Self::Pile => "pile",
            Self::Plane => "plane",
            Self::Cubes => "cubes",
            Self::Balls => "balls",
            Self::Skittles => "skittles",
            Self::Torus => "torus",
            Self::Letters => "letters",
            Self::OneCell => "one-cell",
            Self::Rods => "rods",
            Self::Giants => "giants",
            Self::Far => "far",
            Self::Identical => "identical",
        }
    }

    /// Whether the number of pairs grows with the square of n, so that no engine can be fast.
    pub const fn is_quadratic(self) -> bool {
        matches!(self, Self::Identical)
    }
}

impl fmt::Display for SceneName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl FromStr for SceneName {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        Self::ALL.into_iter().find(|name| name.as_str() == s).ok_or_else(|| UnknownName {
            name: s.to_owned(),
            known: "uniform, mixed, pile, plane, cubes, balls, skittles, torus, letters, one-cell, rods, giants, far, identical".into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back_and_errors_list_them_all() {
        for name in SceneName::ALL {
            assert_eq!(name.to_string().parse::<SceneName>().ok(), Some(name));
        }
        let error = "nowhere".parse::<SceneName>().map_err(|e| e.to_string());
        let Err(text) = error else { panic!("an unknown name must not parse") };
        for name in SceneName::ALL {
            assert!(text.contains(name.as_str()), "{text} lacks {name}");
        }
    }
}
