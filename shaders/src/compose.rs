//! Stages as WGSL text: shared parts put in where `#import NAME` stands, each once. One file, because what a stage is (its
//! text, label and forms) is one list, which each new stage extends in all of its columns.

use pairmask_core::{BoxForm, Encoding, ObjectForm};

use crate::constants::{self, MAX_STRIP_BLOCKS};
use crate::object_parts::{object_form, object_part, rows};
use crate::share_parts::{number_behind, share_part};

/// Rows that a thread of the pairs stage holds in registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u32)]
pub enum RowsPerThread {
    /// One row: most threads.
    One = 1,
    /// Two rows.
    Two = 2,
    /// Four rows: fewest reads of workgroup memory.
    Four = 4,
}

impl RowsPerThread {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::One, Self::Two, Self::Four];
}

/// The forms that the pairs stage is compiled in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PairsVariant {
    /// Rows a thread.
    pub rows: RowsPerThread,
    /// Column blocks of a strip: 1, 2, 4, 8 or 16.
    pub strip_blocks: u32,
    /// Whether zero words are stored too: the dense mask needs them, the sparse one does not.
    pub store_zeros: bool,
}

/// A stage: one WGSL file, one pipeline, one row in a timing table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Boxes of a form to keys and census.
    Keys(BoxForm),
    /// Spheres to what is kept of them, and census.
    SphereKeys,
    /// All pairs of a band.
    Pairs(PairsVariant),
    /// All pairs of a band of spheres.
    SpherePairs(PairsVariant),
    /// Matrix to bit string.
    PackDense,
    /// Matrix to non-zero words.
    WriteSparse,
    /// Matrix to pairs.
    WriteList,
    /// A stage of the grid.
    Grid(GridStage),
    /// A stage of scenes that persist.
    Scene(SceneStage),
    /// Arithmetic that keeps the clocks up.
    Awake,
}

/// What the grid finds and writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Found {
    /// Non-zero mask words in an order of the grid's: a sparse mask.
    Words,
    /// Pairs of boxes: a list.
    Pairs,
}

impl Found {
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::Words, Self::Pairs];

    /// What a mask of an encoding is made of; `None` where the grid has none of that encoding.
    pub const fn of(encoding: Encoding) -> Option<Self> {
        match encoding {
            Encoding::Sparse => Some(Self::Words),
            Encoding::List => Some(Self::Pairs),
            _ => None,
        }
    }

    /// The encoding of its masks.
    pub const fn encoding(self) -> Encoding {
        match self {
            Self::Words => Encoding::Sparse,
            Self::Pairs => Encoding::List,
        }
    }
}

/// Whether a frame has rules.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Rules {
    /// All overlapping pairs are found.
    #[default]
    Without,
    /// Of the pairs those are found whose boxes rules let meet.
    With,
}

impl Rules {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Without, Self::With];
}

/// The stages of the grid, in the order of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum GridStage {
    /// Boxes of a form to keys, cells and census.
    Cells(BoxForm, Rules),
    /// Spheres to what is kept of them, the cells of the boxes around them, and census.
    SphereCells,
    /// Boxes of each cell to first positions.
    Scan,
    /// Indices together by cell.
    Scatter,
    /// Boxes to their positions.
    Place,
    /// Rows against the cells around them.
    Pairs(Found, Rules),
    /// Spheres against those of the cells around them.
    SpherePairs(Found),
    /// What was found to the reply.
    Write(Found, Rules),
}

impl GridStage {
    /// Stages of a frame.
    pub const COUNT: usize = 6;

    /// All of a frame of objects of one form, in order. Spheres have no rules.
    pub const fn of_frame(form: ObjectForm, found: Found, rules: Rules) -> [Self; Self::COUNT] {
        let (cells, pairs) = match form {
            ObjectForm::Boxes(form) => (Self::Cells(form, rules), Self::Pairs(found, rules)),
            ObjectForm::Spheres => (Self::SphereCells, Self::SpherePairs(found)),
        };
        [cells, Self::Scan, Self::Scatter, Self::Place, pairs, Self::Write(found, rules)]
    }

    const fn label(self) -> &'static str {
        match self {
            Self::Cells(..) | Self::SphereCells => "grid_cells",
            Self::Scan => "grid_scan",
            Self::Scatter => "grid_scatter",
            Self::Place => "grid_place",
            Self::Pairs(..) | Self::SpherePairs(_) => "grid_pairs",
            Self::Write(..) => "grid_write",
        }
    }

    const fn file(self) -> &'static str {
        match self {
            Self::Cells(..) | Self::SphereCells => include_str!("../wgsl/grid_cells.wgsl"),
            Self::Scan => include_str!("../wgsl/grid_scan.wgsl"),
            Self::Scatter => include_str!("../wgsl/grid_scatter.wgsl"),
            Self::Place => include_str!("../wgsl/grid_place.wgsl"),
            Self::Pairs(..) | Self::SpherePairs(_) => include_str!("../wgsl/grid_pairs.wgsl"),
            Self::Write(..) => include_str!("../wgsl/grid_write.wgsl"),
        }
    }
}

/// The stages of a scene, in the order of an edit. [`GridStage::Scan`] comes between cells and place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SceneStage {
    /// Boxes that are set to their records.
    Apply,
    /// Boxes that are removed or flagged.
    Mark,
    /// Records to entries and their cells.
    Cells,
    /// Entries to their positions.
    Place,
    /// Entries and rows against entries; sums to the host.
    Pairs,
    /// The same for a share of them: other GPUs do the rest.
    SharedPairs,
    /// Queries against a grid of all boxes.
    Query,
    /// Boxes against a grid of queries.
    QueryRows,
    /// Pairs of each query to first places.
    QueryStarts,
    /// Pairs of each query together.
    QueryDeal,
    /// Pairs of each query in order, to the host.
    QuerySort,
}

impl SceneStage {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Apply,
        Self::Mark,
        Self::Cells,
        Self::Place,
        Self::Pairs,
        Self::SharedPairs,
        Self::Query,
        Self::QueryRows,
        Self::QueryStarts,
        Self::QueryDeal,
        Self::QuerySort,
    ];

    const fn label(self) -> &'static str {
        match self {
            Self::Apply => "scene_apply",
            Self::Mark => "scene_mark",
            Self::Cells => "scene_cells",
            Self::Place => "scene_place",
            Self::Pairs | Self::SharedPairs => "scene_pairs",
            Self::Query => "scene_query",
            Self::QueryRows => "scene_query_rows",
            Self::QueryStarts => "scene_query_starts",
            Self::QueryDeal => "scene_query_deal",
            Self::QuerySort => "scene_query_sort",
        }
    }

    const fn file(self) -> &'static str {
        match self {
            Self::Apply => include_str!("../wgsl/scene_apply.wgsl"),
            Self::Mark => include_str!("../wgsl/scene_mark.wgsl"),
            Self::Cells => include_str!("../wgsl/scene_cells.wgsl"),
            Self::Place => include_str!("../wgsl/scene_place.wgsl"),
            Self::Pairs | Self::SharedPairs => include_str!("../wgsl/scene_pairs.wgsl"),
            Self::Query => include_str!("../wgsl/scene_query.wgsl"),
            Self::QueryRows => include_str!("../wgsl/scene_query_rows.wgsl"),
            Self::QueryStarts => include_str!("../wgsl/scene_query_starts.wgsl"),
            Self::QueryDeal => include_str!("../wgsl/scene_query_deal.wgsl"),
            Self::QuerySort => include_str!("../wgsl/scene_query_sort.wgsl"),
        }
    }
}

/// A stage's text does not fit together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ComposeError {
    /// No shared part has that name.
    #[error("stage {stage} imports '{import}', which is no shared part")]
    UnknownImport {
        /// The stage.
        stage: &'static str,
        /// The name after `#import`.
        import: String,
    },
    /// A strip must be a power of two of at most [`MAX_STRIP_BLOCKS`] column blocks.
    #[error("a strip of {0} column blocks: use 1, 2, 4, 8 or 16")]
    StripBlocks(u32),
}

/// A stage as one WGSL module, and what a pipeline needs to know of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComposedStage {
    /// The name of the file, of the pipeline and of the timing row.
    pub label: &'static str,
    /// The module; its entry point is `main`. It binds storage buffers of group 0, numbered from 0, by the names of what
    /// belongs there.
    pub wgsl: String,
}

/// The shared parts that are files of their own name.
const SHARED: [(&str, &str); 19] = [
    ("box_rules", include_str!("../wgsl/shared/box_rules.wgsl")),
    ("order_keys", include_str!("../wgsl/shared/order_keys.wgsl")),
    ("sphere_bounds", include_str!("../wgsl/shared/sphere_bounds.wgsl")),
    ("sphere_filter", include_str!("../wgsl/shared/sphere_filter.wgsl")),
    ("sphere_exact", include_str!("../wgsl/shared/sphere_exact.wgsl")),
    ("sphere_settled", include_str!("../wgsl/shared/sphere_settled.wgsl")),
    ("box_batch", include_str!("../wgsl/shared/box_batch.wgsl")),
    ("cells", include_str!("../wgsl/shared/cells.wgsl")),
    ("batch", include_str!("../wgsl/shared/batch.wgsl")),
    ("band_words", include_str!("../wgsl/shared/band_words.wgsl")),
    ("grid_params", include_str!("../wgsl/shared/grid_params.wgsl")),
    ("grid_layout", include_str!("../wgsl/shared/grid_layout.wgsl")),
    ("scan", include_str!("../wgsl/shared/scan.wgsl")),
    ("scene_params", include_str!("../wgsl/shared/scene_params.wgsl")),
    ("scene_records", include_str!("../wgsl/shared/scene_records.wgsl")),
    ("cells_around", include_str!("../wgsl/shared/cells_around.wgsl")),
    ("scene_found", include_str!("../wgsl/shared/scene_found.wgsl")),
    ("scene_filter", include_str!("../wgsl/shared/scene_filter.wgsl")),
    ("scene_search", include_str!("../wgsl/shared/scene_search.wgsl")),
];

/// A shared part that is the same in every stage: the constants, or a file of that name.
pub fn shared_part(name: &str) -> Option<String> {
    if name == "constants" {
        return Some(constants::as_wgsl());
    }
    SHARED.iter().find(|(known, _)| *known == name).map(|(_, text)| (*text).to_owned())
}

/// Puts the shared parts in where `#import NAME` stands in `source`, each once. `part` gives the text
/// of a name.
///
/// # Errors
/// Those of `part`.
pub fn compose(
    source: &str,
    part: &dyn Fn(&str) -> Result<String, ComposeError>,
) -> Result<String, ComposeError> {
    let mut text = String::new();
    expand(source, part, &mut Vec::new(), &mut text)?;
    Ok(text)
}

fn expand(
    source: &str,
    part: &dyn Fn(&str) -> Result<String, ComposeError>,
    seen: &mut Vec<String>,
    text: &mut String,
) -> Result<(), ComposeError> {
    for line in source.lines() {
        match line.strip_prefix("#import ") {
            Some(name) if seen.iter().any(|s| s == name) => {}
            Some(name) => {
                seen.push(name.to_owned());
                expand(&part(name)?, part, seen, text)?;
            }
            None => {
                text.push_str(line);
                text.push('\n');
            }
        }
    }
    Ok(())
}

impl Stage {
    /// One of each stage of the engines, for f32 boxes and sparse masks, with the smallest form of the
    /// pairs stage.
    pub const ALL: [Self; 22] = [
        Self::Keys(BoxForm::F32),
        Self::Pairs(PairsVariant { rows: RowsPerThread::One, strip_blocks: 1, store_zeros: true }),
        Self::PackDense,
        Self::WriteSparse,
        Self::WriteList,
        Self::Grid(GridStage::Cells(BoxForm::F32, Rules::Without)),
        Self::Grid(GridStage::Scan),
        Self::Grid(GridStage::Scatter),
        Self::Grid(GridStage::Place),
        Self::Grid(GridStage::Pairs(Found::Words, Rules::Without)),
        Self::Grid(GridStage::Write(Found::Words, Rules::Without)),
        Self::Scene(SceneStage::Apply),
        Self::Scene(SceneStage::Mark),
        Self::Scene(SceneStage::Cells),
        Self::Scene(SceneStage::Place),
        Self::Scene(SceneStage::Pairs),
        Self::Scene(SceneStage::Query),
        Self::Scene(SceneStage::QueryRows),
        Self::Scene(SceneStage::QueryStarts),
        Self::Scene(SceneStage::QueryDeal),
        Self::Scene(SceneStage::QuerySort),
        Self::Awake,
    ];

    /// The name of the file, of the pipeline and of the timing row.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Keys(_) | Self::SphereKeys => "keys",
            Self::Pairs(_) | Self::SpherePairs(_) => "pairs",
            Self::PackDense => "pack_dense",
            Self::WriteSparse => "write_sparse",
            Self::WriteList => "write_list",
            Self::Grid(stage) => stage.label(),
            Self::Scene(stage) => stage.label(),
            Self::Awake => "awake",
        }
    }

    /// The file as it is.
    const fn file(self) -> &'static str {
        match self {
            Self::Keys(_) | Self::SphereKeys => include_str!("../wgsl/keys.wgsl"),
            Self::Pairs(_) | Self::SpherePairs(_) => include_str!("../wgsl/pairs.wgsl"),
            Self::PackDense => include_str!("../wgsl/pack_dense.wgsl"),
            Self::WriteSparse => include_str!("../wgsl/write_sparse.wgsl"),
            Self::WriteList => include_str!("../wgsl/write_list.wgsl"),
            Self::Grid(stage) => stage.file(),
            Self::Scene(stage) => stage.file(),
            Self::Awake => include_str!("../wgsl/awake.wgsl"),
        }
    }

    /// The stage as one WGSL module.
    ///
    /// # Errors
    /// [`ComposeError`].
    ///
    /// ```
    /// use pairmask_core::BoxForm;
    /// use pairmask_shaders::Stage;
    /// let text = Stage::Keys(BoxForm::Q8).wgsl()?;
    /// assert!(text.contains("fn order_key"), "the shared part is in");
    /// # Ok::<(), pairmask_shaders::ComposeError>(())
    /// ```
    pub fn wgsl(self) -> Result<String, ComposeError> {
        let text = compose(self.file(), &|name| self.shared(name))?;
        Ok(number_behind(&text))
    }

    /// The stage as one WGSL module, with its name.
    ///
    /// # Errors
    /// [`ComposeError`].
    pub fn composed(self) -> Result<ComposedStage, ComposeError> {
        Ok(ComposedStage { label: self.label(), wgsl: self.wgsl()? })
    }

    fn shared(self, name: &str) -> Result<String, ComposeError> {
        let unknown =
            || ComposeError::UnknownImport { stage: self.label(), import: name.to_owned() };
        match (name, self) {
            ("constants", Self::Pairs(variant) | Self::SpherePairs(variant)) => {
                let strip = variant.strip_blocks;
                if !strip.is_power_of_two() || strip > MAX_STRIP_BLOCKS {
                    return Err(ComposeError::StripBlocks(strip));
                }
                Ok(constants::as_wgsl()
                    + &format!("const STRIP_BLOCKS: u32 = {strip}u;\n")
                    + &format!("const STORE_ZEROS: bool = {};\n", variant.store_zeros))
            }
            ("constants", _) => {
                let bytes = object_form(self);
                let bytes = bytes.map(|(bytes, _)| format!("const BOX_BYTES: u32 = {bytes}u;\n"));
                Ok(constants::as_wgsl() + &bytes.unwrap_or_default())
            }
            ("box_form", _) => Ok(object_form(self).ok_or_else(unknown)?.1.to_owned()),
            ("rows", _) => rows(self).ok_or_else(unknown),
            ("found", Self::Grid(GridStage::Pairs(found, _) | GridStage::SpherePairs(found))) => {
                Ok(match found {
                    Found::Words => include_str!("../wgsl/shared/found_words.wgsl"),
                    Found::Pairs => include_str!("../wgsl/shared/found_pairs.wgsl"),
                }
                .to_owned())
            }
            ("written", Self::Grid(GridStage::Write(found, _))) => Ok(match found {
                Found::Words => include_str!("../wgsl/shared/written_words.wgsl"),
                Found::Pairs => include_str!("../wgsl/shared/written_pairs.wgsl"),
            }
            .to_owned()),
            _ => {
                let own = object_part(self, name).or_else(|| share_part(self, name));
                own.or_else(|| shared_part(name)).ok_or_else(unknown)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_parts_come_once_and_unknown_ones_are_refused() {
        let twice = "#import batch\n#import batch\n";
        let text = compose(twice, &|name| Stage::PackDense.shared(name)).expect("known");
        assert_eq!(text.matches("struct BatchReport").count(), 1);
        for (stage, label, import) in [
            (Stage::Keys(BoxForm::F16), "keys", "rows"),
            (Stage::PackDense, "pack_dense", "box_form"),
            (Stage::WriteList, "write_list", "found"),
            (Stage::Grid(GridStage::Pairs(Found::Pairs, Rules::With)), "grid_pairs", "written"),
        ] {
            let found = compose(&format!("#import {import}\n"), &|name| stage.shared(name));
            let unknown = ComposeError::UnknownImport { stage: label, import: import.into() };
            assert_eq!(found, Err(unknown));
        }
    }

    #[test]
    fn a_strip_that_is_no_power_of_two_is_refused() {
        for strip_blocks in [0, 3, 32] {
            let variant =
                PairsVariant { rows: RowsPerThread::One, strip_blocks, store_zeros: true };
            assert_eq!(Stage::Pairs(variant).wgsl(), Err(ComposeError::StripBlocks(strip_blocks)));
        }
    }
}
