//! Stages as WGSL text: shared parts put in where `#import NAME` stands, each once. What a stage says that depends on
//! its form comes from a file of that form, or from a section of one, which starts with a line `#part NAME`; a part
//! may stand within a function.

use pairmask_core::{BoxForm, Encoding, ObjectForm};

use crate::constants;

/// Rows that a thread of the pairs stage holds in registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u32)]
pub enum RowsPerThread {
    /// Most threads.
    One = 1,
    Two = 2,
    /// Fewest reads of workgroup memory.
    Four = 4,
}

impl RowsPerThread {
    pub const ALL: [Self; 3] = [Self::One, Self::Two, Self::Four];
}

/// The forms that the pairs stage is compiled in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PairsVariant {
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
    Grid(GridStage),
    /// A stage of persistent scenes.
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
    Slot,
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
        [cells, Self::Scan, Self::Scatter, Self::Slot, pairs, Self::Write(found, rules)]
    }

    const fn has_rules(self) -> bool {
        matches!(
            self,
            Self::Cells(_, Rules::With) | Self::Pairs(_, Rules::With) | Self::Write(_, Rules::With)
        )
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
    Slot,
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
    /// Records to the boxes of a tree, and groups of them.
    CastBoxes,
    /// Groups of a level to those of the next.
    CastGroups,
    /// Rays against the tree, candidates to the host.
    CastRays,
    /// Spheres against the tree, candidates to the host.
    CastSpheres,
}

impl SceneStage {
    pub const ALL: [Self; 15] = [
        Self::Apply,
        Self::Mark,
        Self::Cells,
        Self::Slot,
        Self::Pairs,
        Self::SharedPairs,
        Self::Query,
        Self::QueryRows,
        Self::QueryStarts,
        Self::QueryDeal,
        Self::QuerySort,
        Self::CastBoxes,
        Self::CastGroups,
        Self::CastRays,
        Self::CastSpheres,
    ];
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

/// The name of a stage's file, and its text.
macro_rules! file {
    ($name:literal) => {
        ($name, include_str!(concat!("../wgsl/", $name, ".wgsl")))
    };
}

/// Shared files by their names.
macro_rules! shared {
    ($($name:literal)+) => {
        &[$(($name, include_str!(concat!("../wgsl/shared/", $name, ".wgsl")))),+]
    };
}

pub(crate) const SHARED: &[(&str, &str)] = shared! {
    "band_words" "batch" "box_batch" "box_rules" "box_worlds_none" "box_worlds_ruled" "boxes_f16"
    "boxes_f32" "boxes_q16" "boxes_q8" "boxes_spheres" "cast_bounds" "cast_params" "cast_ray"
    "cast_sphere" "cells" "cells_around" "found_pairs"
    "found_words" "grid_layout" "grid_of_boxes" "grid_of_spheres" "grid_params" "order_keys"
    "pair_rules_none" "pair_rules_ruled" "pairs_of_boxes" "pairs_of_spheres" "rows_1" "rows_2"
    "rows_4" "scan" "scene_filter" "scene_found" "scene_history" "scene_params" "scene_records" "scene_search"
    "scene_share_part" "scene_share_whole" "sphere_bounds" "sphere_exact" "sphere_filter"
    "sphere_rows_1" "sphere_rows_2" "sphere_rows_4" "sphere_settled" "written_pairs"
    "written_words" "written_worlds_none" "written_worlds_ruled"
};

/// A shared part that is the same in every stage: the constants, or a file of that name.
pub fn shared_part(name: &str) -> Option<String> {
    if name == "constants" {
        return Some(constants::as_wgsl());
    }
    SHARED.iter().find(|(known, _)| *known == name).map(|(_, text)| (*text).to_owned())
}

/// Puts the shared parts in where `#import NAME` stands in `source`, each once. `part` gives the text
/// of a name; the line of one that it does not know stays, and is no WGSL.
pub fn compose(source: &str, part: &dyn Fn(&str) -> Option<String>) -> String {
    let mut text = String::new();
    expand(source, part, &mut Vec::new(), &mut text);
    text
}

fn expand(
    source: &str,
    part: &dyn Fn(&str) -> Option<String>,
    seen: &mut Vec<String>,
    text: &mut String,
) {
    for line in source.lines() {
        let import = line.strip_prefix("#import ");
        if import.is_some_and(|name| seen.iter().any(|s| s == name)) {
            continue;
        }
        if let Some((name, part_text)) = import.and_then(|name| Some((name, part(name)?))) {
            seen.push(name.to_owned());
            expand(&part_text, part, seen, text);
        } else {
            text.push_str(line);
            text.push('\n');
        }
    }
}

/// The section of that name, without the blank lines around it.
fn section(text: &str, name: &str) -> Option<String> {
    let mut sections = text.split("#part ").skip(1).filter_map(|part| part.split_once('\n'));
    let (_, body) = sections.find(|(head, _)| *head == name)?;
    let body = body.trim_matches('\n');
    Some(if body.is_empty() { String::new() } else { format!("{body}\n") })
}

/// Numbers the bindings of rules, which come behind all others of a stage.
fn number_behind(text: &str) -> String {
    let count = |what| text.matches(what).count();
    let behind = count("@binding(") - count("@binding(BEHIND");
    let numbered = text.replace("@binding(BEHIND)", &format!("@binding({behind})"));
    numbered.replace("@binding(BEHIND_THAT)", &format!("@binding({})", behind + 1))
}

impl Stage {
    /// The name of the file, of the pipeline and of the timing row.
    pub const fn label(self) -> &'static str {
        self.file().0
    }

    const fn file(self) -> (&'static str, &'static str) {
        match self {
            Self::Keys(_) | Self::SphereKeys => file!("keys"),
            Self::Pairs(_) | Self::SpherePairs(_) => file!("pairs"),
            Self::PackDense => file!("pack_dense"),
            Self::WriteSparse => file!("write_sparse"),
            Self::WriteList => file!("write_list"),
            Self::Awake => file!("awake"),
            Self::Grid(GridStage::Cells(..) | GridStage::SphereCells) => file!("grid_cells"),
            Self::Grid(GridStage::Scan) => file!("grid_scan"),
            Self::Grid(GridStage::Scatter) => file!("grid_scatter"),
            Self::Grid(GridStage::Slot) => file!("grid_slot"),
            Self::Grid(GridStage::Pairs(..) | GridStage::SpherePairs(_)) => file!("grid_pairs"),
            Self::Grid(GridStage::Write(..)) => file!("grid_write"),
            Self::Scene(SceneStage::Apply) => file!("scene_apply"),
            Self::Scene(SceneStage::Mark) => file!("scene_mark"),
            Self::Scene(SceneStage::Cells) => file!("scene_cells"),
            Self::Scene(SceneStage::Slot) => file!("scene_slot"),
            Self::Scene(SceneStage::Pairs | SceneStage::SharedPairs) => file!("scene_pairs"),
            Self::Scene(SceneStage::Query) => file!("scene_query"),
            Self::Scene(SceneStage::QueryRows) => file!("scene_query_rows"),
            Self::Scene(SceneStage::QueryStarts) => file!("scene_query_starts"),
            Self::Scene(SceneStage::QueryDeal) => file!("scene_query_deal"),
            Self::Scene(SceneStage::QuerySort) => file!("scene_query_sort"),
            Self::Scene(SceneStage::CastBoxes) => file!("cast_boxes"),
            Self::Scene(SceneStage::CastGroups) => file!("cast_groups"),
            Self::Scene(SceneStage::CastRays | SceneStage::CastSpheres) => file!("cast"),
        }
    }

    /// The stage as one WGSL module.
    ///
    /// ```
    /// use pairmask_core::BoxForm;
    /// use pairmask_shaders::Stage;
    /// let text = Stage::Keys(BoxForm::Q8).composed().wgsl;
    /// assert!(text.contains("fn order_key"), "the shared part is in");
    /// ```
    pub fn composed(self) -> ComposedStage {
        let (label, text) = self.file();
        ComposedStage { label, wgsl: number_behind(&compose(text, &|name| self.part(name))) }
    }

    /// What stands for `#import name` in this stage.
    pub(crate) fn part(self, name: &str) -> Option<String> {
        let file = match (name, self) {
            ("constants", _) => return Some(constants::as_wgsl() + &self.own_constants()),
            ("box_form", _) => self.objects()?.1.to_owned(),
            ("rows", Self::Pairs(variant)) => format!("rows_{}", variant.rows as u32),
            ("rows", Self::SpherePairs(variant)) => {
                let rows = variant.rows as u32;
                let own = shared_part(&format!("sphere_rows_{rows}"))?;
                return Some(format!("{}\n{own}", shared_part(&format!("rows_{rows}"))?));
            }
            ("found", Self::Grid(GridStage::Pairs(found, _) | GridStage::SpherePairs(found)))
            | ("written", Self::Grid(GridStage::Write(found, _))) => match found {
                Found::Words => format!("{name}_words"),
                Found::Pairs => format!("{name}_pairs"),
            },
            ("scene_share", Self::Scene(SceneStage::SharedPairs)) => "scene_share_part".to_owned(),
            ("scene_share", Self::Scene(_)) => "scene_share_whole".to_owned(),
            ("cast_question", Self::Scene(SceneStage::CastRays)) => "cast_ray".to_owned(),
            ("cast_question", Self::Scene(_)) => "cast_sphere".to_owned(),
            ("box_worlds" | "pair_rules" | "written_worlds", Self::Grid(stage)) => {
                format!("{name}_{}", if stage.has_rules() { "ruled" } else { "none" })
            }
            _ => {
                let sections = self.sections().and_then(shared_part);
                let own = sections.and_then(|text| section(&text, name));
                return own.or_else(|| shared_part(name));
            }
        };
        shared_part(&file)
    }

    /// The file with what this stage says of the objects, boxes or spheres.
    const fn sections(self) -> Option<&'static str> {
        match self {
            Self::Pairs(_) => Some("pairs_of_boxes"),
            Self::SpherePairs(_) => Some("pairs_of_spheres"),
            Self::Keys(_) | Self::Grid(GridStage::Cells(..) | GridStage::Pairs(..)) => {
                Some("grid_of_boxes")
            }
            Self::SphereKeys | Self::Grid(GridStage::SphereCells | GridStage::SpherePairs(_)) => {
                Some("grid_of_spheres")
            }
            _ => None,
        }
    }

    /// How the objects that a stage reads lie in memory: bytes of one, and the file that makes bits of a box of it.
    /// `None` for a stage that reads none.
    const fn objects(self) -> Option<(usize, &'static str)> {
        let form = match self {
            Self::SphereKeys | Self::Grid(GridStage::SphereCells) => {
                return Some((pairmask_core::sphere::SPHERE_BYTES, "boxes_spheres"));
            }
            Self::Keys(form) | Self::Grid(GridStage::Cells(form, _)) => form,
            Self::Scene(SceneStage::Apply) => BoxForm::F32,
            _ => return None,
        };
        let file = match form {
            BoxForm::F32 => "boxes_f32",
            BoxForm::Q16 => "boxes_q16",
            BoxForm::Q8 => "boxes_q8",
            BoxForm::F16 => "boxes_f16",
        };
        Some((form.box_bytes(), file))
    }

    fn own_constants(self) -> String {
        match (self, self.objects()) {
            (Self::Pairs(variant) | Self::SpherePairs(variant), _) => format!(
                "const STRIP_BLOCKS: u32 = {}u;\nconst STORE_ZEROS: bool = {};\n",
                variant.strip_blocks, variant.store_zeros
            ),
            (_, Some((bytes, _))) => format!("const BOX_BYTES: u32 = {bytes}u;\n"),
            _ => String::new(),
        }
    }
}
