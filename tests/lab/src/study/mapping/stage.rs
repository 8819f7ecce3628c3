//! The stages of the mapping study: every way to turn an id k into a pair (a, b), by name.
//!
//! Sources: Q. Avril, V. Gouranton, B. Arnaldi, "Fast collision culling in large-scale
//! environments using GPU mapping function", EGPGV 2012, §3 (closed form, corrections, lazy way,
//! table 3's constants); C. Lomont, "Fast inverse square root", 2003; C. A. Navarro et al. on
//! folding a triangle. None of these stages serves a client: production uses
//! `pairmask_core::pair_index` and integer searches only.

use std::fmt::{self, Write};

use pairmask_shaders::{ComposeError, ComposedStage, compose, shared_part};
use serde::{Serialize, Serializer};

/// First guesses of an inverse square root, subtracted from half the bits of the number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Magic {
    /// The constant of Quake III, which the paper ascribes to Carmack.
    Carmack = 0x5f37_59df,
    Lomont = 0x5f37_5a86,
}

/// Newton steps after the first guess.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Steps {
    /// One: the code that the paper prints.
    One = 1,
    Two = 2,
    Three = 3,
    Four = 4,
}

impl Steps {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::One, Self::Two, Self::Three, Self::Four];
}

/// The way to compute a square root.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Root {
    /// The language's: correctly rounded on CPUs, nearly so on GPUs.
    BuiltIn,
    Newton(Magic, Steps),
}

impl Root {
    /// All roots: the built-in one first.
    pub fn all() -> impl Iterator<Item = Self> + Clone {
        let newton = [Magic::Carmack, Magic::Lomont]
            .into_iter()
            .flat_map(|magic| Steps::ALL.map(|steps| Self::Newton(magic, steps)));
        std::iter::once(Self::BuiltIn).chain(newton)
    }
}

impl fmt::Display for Root {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BuiltIn => f.write_str("sqrt"),
            Self::Newton(Magic::Carmack, steps) => write!(f, "carmack-{}", *steps as u32),
            Self::Newton(Magic::Lomont, steps) => write!(f, "lomont-{}", *steps as u32),
        }
    }
}

impl Serialize for Root {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// The way to compute the discriminant 4n² − 4n − 8k + 1 of the closed form.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Discriminant {
    /// In f32, term by term as the paper writes it: large terms cancel.
    Float,
    /// The subtraction in integers, then one conversion: off by one row at most, so that the
    /// corrections suffice.
    Integer,
}

/// A way from an id to a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Variant {
    /// The paper's closed form.
    Closed {
        root: Root,
        discriminant: Discriminant,
        /// Whether the two corrections of §3.3 follow (b > n; a ≥ b).
        corrected: bool,
    },
    /// Closed form from the far end, where nothing cancels, with one integer fix-up.
    FarEnd,
    /// Binary search on the first ids of rows.
    RowSearch,
    /// Triangle folded into a rectangle; another order of ids.
    Fold,
    /// One search a word of 32 ids, then steps.
    WordStep,
    /// (k / n, k % n): half of the ids are no pair.
    Lazy,
}

impl Variant {
    /// Every variant, in the order of the report.
    pub fn all() -> impl Iterator<Item = Self> + Clone {
        let closed = |root, discriminant| {
            [false, true].map(|corrected| Self::Closed { root, discriminant, corrected })
        };
        Root::all()
            .flat_map(move |root| closed(root, Discriminant::Float))
            .chain(closed(Root::BuiltIn, Discriminant::Integer))
            .chain([Self::FarEnd, Self::RowSearch, Self::Fold, Self::WordStep, Self::Lazy])
    }

    /// The variant's own number of ids for `n` boxes: n(n − 1)/2, or n² − n the lazy way.
    pub const fn id_count(self, n: u32) -> u64 {
        let n = n as u64;
        let ordered = n * n.saturating_sub(1);
        if matches!(self, Self::Lazy) { ordered } else { ordered / 2 }
    }
}

impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Closed { root, discriminant, corrected } => {
                f.write_str("closed ")?;
                if *discriminant == Discriminant::Integer {
                    f.write_str("integer-")?;
                }
                root.fmt(f)?;
                f.write_str(if *corrected { " corrected" } else { "" })
            }
            Self::FarEnd => f.write_str("far-end"),
            Self::RowSearch => f.write_str("row-search"),
            Self::Fold => f.write_str("fold"),
            Self::WordStep => f.write_str("word-step"),
            Self::Lazy => f.write_str("lazy"),
        }
    }
}

impl Serialize for Variant {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// The paper's way with a square root: its closed form with the built-in one.
pub const PAPERS_OWN: Variant =
    Variant::Closed { root: Root::BuiltIn, discriminant: Discriminant::Float, corrected: false };

/// Bits of an id on the GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum IdWidth {
    /// As long as all ids fit: up to 92,682 boxes (65,536 the lazy way).
    Bits32,
    /// Beyond. Needs a device with 64-bit integers.
    Bits64,
}

impl IdWidth {
    /// The narrowest width for the ids of a variant.
    pub const fn of(variant: Variant, n: u32) -> Self {
        if variant.id_count(n) <= u32::MAX as u64 { Self::Bits32 } else { Self::Bits64 }
    }
}

/// The output of a pair in the output study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PairOutput {
    Byte,
    Bit,
}

impl PairOutput {
    /// Pairs of a 32-bit word.
    pub const fn pairs_per_word(self) -> u32 {
        match self {
            Self::Byte => 4,
            Self::Bit => 32,
        }
    }
}

/// A stage of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MappingStage {
    #[cfg(test)]
    Pairs(Variant, IdWidth),
    /// Wrong ids and named pairs, counted.
    Errors(Variant, IdWidth),
    Time(Variant, IdWidth),
    /// Wrong integer parts of roots, counted.
    RootErrors(Root),
    RootTime(Root),
    /// All pairs of boxes; one thread a word of output.
    Mask(PairOutput),
    /// All pairs of boxes; one thread a pair, which ORs its result in.
    MaskOr(PairOutput),
}

/// The form of the mapping that the output study uses: the paper's, corrected. From 5,794 boxes on
/// (k past 2^24) it misses a pair or two, which changes no time.
pub const MASK_VARIANT: Variant =
    Variant::Closed { root: Root::BuiltIn, discriminant: Discriminant::Float, corrected: true };

impl MappingStage {
    /// Every form that the study runs.
    #[cfg(test)]
    pub fn all_forms() -> Vec<Self> {
        let mut forms = Vec::new();
        for width in [IdWidth::Bits32, IdWidth::Bits64] {
            for variant in Variant::all() {
                forms.extend([
                    Self::Pairs(variant, width),
                    Self::Errors(variant, width),
                    Self::Time(variant, width),
                ]);
            }
        }
        forms.extend(Root::all().flat_map(|root| [Self::RootErrors(root), Self::RootTime(root)]));
        for output in [PairOutput::Byte, PairOutput::Bit] {
            forms.extend([Self::Mask(output), Self::MaskOr(output)]);
        }
        forms
    }

    /// Name, file, and storage buffers, numbered from 0.
    pub const fn parts(self) -> (&'static str, &'static str, u32) {
        macro_rules! stage {
            ($name:literal, $bindings:literal) => {
                ($name, include_str!(concat!("../../../shaders/", $name, ".wgsl")), $bindings)
            };
        }
        match self {
            #[cfg(test)]
            Self::Pairs(..) => stage!("mapping_pairs", 2),
            Self::Errors(..) => stage!("mapping_errors", 2),
            Self::Time(..) => stage!("mapping_time", 1),
            Self::RootErrors(_) => stage!("mapping_root_errors", 1),
            Self::RootTime(_) => stage!("mapping_root_time", 1),
            Self::Mask(_) => stage!("mapping_mask", 2),
            Self::MaskOr(_) => stage!("mapping_mask_or", 2),
        }
    }

    fn map(self) -> Option<(Variant, IdWidth)> {
        match self {
            #[cfg(test)]
            Self::Pairs(variant, width) => Some((variant, width)),
            Self::Errors(variant, width) | Self::Time(variant, width) => Some((variant, width)),
            Self::Mask(_) | Self::MaskOr(_) => Some((MASK_VARIANT, IdWidth::Bits32)),
            Self::RootErrors(_) | Self::RootTime(_) => None,
        }
    }

    fn root(self) -> Option<Root> {
        match (self, self.map()) {
            (Self::RootErrors(root) | Self::RootTime(root), _)
            | (_, Some((Variant::Closed { root, .. }, _))) => Some(root),
            _ => None,
        }
    }

    /// The shared part that `name` stands for in this stage, if it is one of the study's.
    fn shared(self, name: &str) -> Option<String> {
        Some(match name {
            "pair_ids" => self.id_type()? + include_str!("../../../shaders/shared/pair_ids.wgsl"),
            "map" => self.map_text()?,
            "root" => root_text(self.root()?),
            "each_id" => include_str!("../../../shaders/shared/each_id.wgsl").to_owned(),
            "row_order" => include_str!("../../../shaders/shared/row_order.wgsl").to_owned(),
            "mask_test" => {
                let (Self::Mask(output) | Self::MaskOr(output)) = self else { return None };
                format!("const PAIRS_PER_WORD: u32 = {}u;\n", output.pairs_per_word())
                    + include_str!("../../../shaders/shared/mask_test.wgsl")
            }
            _ => return None,
        })
    }

    fn id_type(self) -> Option<String> {
        let (bits, id_of) = match self.map()?.1 {
            IdWidth::Bits32 => (32, "low"),
            IdWidth::Bits64 => (64, "Id(low) | (Id(high) << 32u)"),
        };
        Some(format!(
            "alias Id = u{bits};\nalias SignedId = i{bits};\n\n\
             fn id_of(low: u32, high: u32) -> Id {{\n    return {id_of};\n}}\n\n"
        ))
    }

    fn map_text(self) -> Option<String> {
        let variant = self.map()?.0;
        let mut text = format!("const MAY_SKIP: bool = {};\n", variant == Variant::Lazy);
        if let Variant::Closed { discriminant, corrected, .. } = variant {
            let integer = discriminant == Discriminant::Integer;
            // Writing to a String cannot fail.
            let _ = writeln!(text, "const INTEGER_DISCRIMINANT: bool = {integer};");
            let _ = writeln!(text, "const CORRECTED: bool = {corrected};\n");
        }
        text += match variant {
            Variant::Closed { .. } => include_str!("../../../shaders/shared/map_closed.wgsl"),
            Variant::FarEnd => include_str!("../../../shaders/shared/map_far_end.wgsl"),
            Variant::RowSearch => include_str!("../../../shaders/shared/map_row_search.wgsl"),
            Variant::Fold => include_str!("../../../shaders/shared/map_fold.wgsl"),
            Variant::WordStep => include_str!("../../../shaders/shared/map_word_step.wgsl"),
            Variant::Lazy => include_str!("../../../shaders/shared/map_lazy.wgsl"),
        };
        Some(text)
    }
}

impl MappingStage {
    /// The stage as one WGSL module, with its name and bindings.
    pub fn composed(self) -> Result<ComposedStage, ComposeError> {
        let (label, file, binding_count) = self.parts();
        let unknown =
            |name: &str| ComposeError::UnknownImport { stage: label, import: name.to_owned() };
        let part = |name: &str| {
            self.shared(name).or_else(|| shared_part(name)).ok_or_else(|| unknown(name))
        };
        Ok(ComposedStage { label, binding_count, wgsl: compose(file, &part)? })
    }
}

fn root_text(root: Root) -> String {
    match root {
        Root::BuiltIn => include_str!("../../../shaders/shared/root_built_in.wgsl").to_owned(),
        Root::Newton(magic, steps) => {
            format!(
                "const ROOT_MAGIC: u32 = {:#x}u;\nconst NEWTON_STEPS: u32 = {}u;\n\n",
                magic as u32, steps as u32
            ) + include_str!("../../../shaders/shared/root_newton.wgsl")
        }
    }
}
