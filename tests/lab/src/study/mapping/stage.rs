//! The stages of the mapping study: every way to turn an id k into a pair (a, b), by name.
//!
//! Sources: Avril et al. 2012, §3 (closed form, corrections, lazy way, table 3's constants); C. Lomont, "Fast inverse
//! square root", 2003; C. A. Navarro et al. on folding a triangle.

use std::fmt;

use pairmask_shaders::{ComposedStage, compose, shared_part};

/// First guesses of an inverse square root, subtracted from half the bits of the number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Magic {
    /// The constant of Quake III, which the paper ascribes to Carmack.
    Carmack = 0x5f37_59df,
    Lomont = 0x5f37_5a86,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Root {
    /// The language's: correctly rounded on CPUs, nearly so on GPUs.
    BuiltIn,
    /// A first guess and 1 to 4 steps of Newton; one is the code that the paper prints.
    Newton(Magic, u32),
}

impl Root {
    pub fn all() -> impl Iterator<Item = Self> + Clone {
        let steps = |magic| (1..=4).map(move |steps| Self::Newton(magic, steps));
        std::iter::once(Self::BuiltIn).chain(steps(Magic::Carmack)).chain(steps(Magic::Lomont))
    }
}

impl fmt::Display for Root {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BuiltIn => f.write_str("sqrt"),
            Self::Newton(Magic::Carmack, steps) => write!(f, "carmack-{steps}"),
            Self::Newton(Magic::Lomont, steps) => write!(f, "lomont-{steps}"),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Variant {
    Closed {
        root: Root,
        /// Whether the discriminant 4n² − 4n − 8k + 1 is subtracted in integers, then converted once: off by one
        /// row at most, so that the corrections suffice. Else in f32, term by term as the paper writes it: large
        /// terms cancel.
        integer: bool,
        /// Whether the two corrections of §3.3 follow (b > n; a ≥ b).
        corrected: bool,
    },
    /// Closed form from the far end, where nothing cancels, with one integer fix-up.
    FarEnd,
    RowSearch,
    /// Triangle folded into a rectangle; another order of ids.
    Fold,
    /// One search a word of 32 ids, then steps.
    WordStep,
    /// (k / n, k % n): half of the ids are no pair.
    Lazy,
}

impl Variant {
    pub fn all() -> impl Iterator<Item = Self> + Clone {
        let closed = |root, integer| {
            [false, true].map(|corrected| Self::Closed { root, integer, corrected })
        };
        Root::all()
            .flat_map(move |root| closed(root, false))
            .chain(closed(Root::BuiltIn, true))
            .chain([Self::FarEnd, Self::RowSearch, Self::Fold, Self::WordStep, Self::Lazy])
    }

    /// The variant's own number of ids for `n` boxes: n(n − 1)/2, or n² − n the lazy way.
    pub const fn id_count(self, n: u32) -> u64 {
        let n = n as u64;
        let ordered = n * n.saturating_sub(1);
        if matches!(self, Self::Lazy) { ordered } else { ordered / 2 }
    }

    /// Whether the ids of `n` boxes need 64 bits: beyond 92,682 boxes, 65,536 the lazy way.
    pub const fn is_wide(self, n: u32) -> bool {
        self.id_count(n) > u32::MAX as u64
    }
}

impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Closed { root, integer, corrected } => {
                let integer = if *integer { "integer-" } else { "" };
                let corrected = if *corrected { " corrected" } else { "" };
                return write!(f, "closed {integer}{root}{corrected}");
            }
            Self::FarEnd => "far-end",
            Self::RowSearch => "row-search",
            Self::Fold => "fold",
            Self::WordStep => "word-step",
            Self::Lazy => "lazy",
        })
    }
}

/// The paper's way with a square root: its closed form with the built-in one.
pub const PAPERS_OWN: Variant =
    Variant::Closed { root: Root::BuiltIn, integer: false, corrected: false };

/// The form of the mapping that the output study uses: the paper's, corrected. From 5,794 boxes on
/// (k past 2^24) it misses a pair or two, which changes no time.
pub const MASK_VARIANT: Variant =
    Variant::Closed { root: Root::BuiltIn, integer: false, corrected: true };

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct File {
    pub label: &'static str,
    text: &'static str,
}

macro_rules! file {
    ($name:literal) => {
        File { label: $name, text: include_str!(concat!("../../../shaders/", $name, ".wgsl")) }
    };
}

#[cfg(test)]
pub const PAIRS: File = file!("mapping_pairs");
pub const ERRORS: File = file!("mapping_errors");
pub const TIME: File = file!("mapping_time");
pub const ROOT_ERRORS: File = file!("mapping_root_errors");
pub const ROOT_TIME: File = file!("mapping_root_time");
/// All pairs of boxes; one thread a word of output.
pub const MASK: File = file!("mapping_mask");
/// All pairs of boxes; one thread a pair, which ORs its result in.
pub const MASK_OR: File = file!("mapping_mask_or");

/// A stage of the study: a file and what it is composed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MappingStage {
    /// A way, and whether ids have 64 bits, for which a device needs such integers.
    Map(File, Variant, bool),
    Root(File, Root),
    Mask(File, u32),
}

macro_rules! shared {
    ($name:literal) => {
        include_str!(concat!("../../../shaders/shared/", $name, ".wgsl"))
    };
}

impl MappingStage {
    pub const fn file(self) -> File {
        let (Self::Map(file, ..) | Self::Root(file, _) | Self::Mask(file, _)) = self;
        file
    }

    /// The shared part that `name` stands for in this stage, if it is one of the study's.
    fn shared(self, name: &str) -> Option<String> {
        let (map, root) = match self {
            Self::Map(_, variant @ Variant::Closed { root, .. }, is_wide) => {
                (Some((variant, is_wide)), Some(root))
            }
            Self::Map(_, variant, is_wide) => (Some((variant, is_wide)), None),
            Self::Mask(..) => (Some((MASK_VARIANT, false)), Some(Root::BuiltIn)),
            Self::Root(_, root) => (None, Some(root)),
        };
        Some(match name {
            "pair_ids" => {
                let (bits, id_of) =
                    if map?.1 { (64, "Id(low) | (Id(high) << 32u)") } else { (32, "low") };
                format!(
                    "alias Id = u{bits};\nalias SignedId = i{bits};\n\n\
                     fn id_of(low: u32, high: u32) -> Id {{\n    return {id_of};\n}}\n\n"
                ) + shared!("pair_ids")
            }
            "map" => {
                let variant = map?.0;
                let constant = |name: &str, is_so| format!("const {name}: bool = {is_so};\n");
                let text = match variant {
                    Variant::Closed { integer, corrected, .. } => {
                        constant("INTEGER_DISCRIMINANT", integer)
                            + &constant("CORRECTED", corrected)
                            + shared!("map_closed")
                    }
                    Variant::FarEnd => shared!("map_far_end").to_owned(),
                    Variant::RowSearch => shared!("map_row_search").to_owned(),
                    Variant::Fold => shared!("map_fold").to_owned(),
                    Variant::WordStep => shared!("map_word_step").to_owned(),
                    Variant::Lazy => shared!("map_lazy").to_owned(),
                };
                constant("MAY_SKIP", variant == Variant::Lazy) + &text
            }
            "root" => match root? {
                Root::BuiltIn => shared!("root_built_in").to_owned(),
                Root::Newton(magic, steps) => {
                    let magic = magic as u32;
                    format!(
                        "const ROOT_MAGIC: u32 = {magic:#x}u;\nconst NEWTON_STEPS: u32 = {steps}u;\n\n"
                    ) + shared!("root_newton")
                }
            },
            "each_id" => shared!("each_id").to_owned(),
            "row_order" => shared!("row_order").to_owned(),
            "mask_test" => {
                let Self::Mask(_, bits) = self else { return None };
                format!("const PAIRS_PER_WORD: u32 = {}u;\n", 32 / bits) + shared!("mask_test")
            }
            _ => return None,
        })
    }

    pub fn composed(self) -> ComposedStage {
        let File { label, text } = self.file();
        let part = |name: &str| self.shared(name).or_else(|| shared_part(name));
        ComposedStage { label, wgsl: compose(text, &part) }
    }
}
