//! The stages of scenes in video memory, each by itself beside plain Rust: what a stage leaves behind in every
//! word that it may write, and that it writes no other. `scene_pairs` is held to the core by whole answers.
//!
//! Each comparison is shown to fail for stages whose text was altered. One file, because its stages share
//! the bench, the records and the search that they are held to.

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::Aabb;
use pairmask_core::aabb::{KeyBox, order_key};
use pairmask_core::precision::BoxSlice;
use pairmask_shaders::constants::{
    BATCH_BOXES, CONTROL_HEADER_WORDS, MARK_NAMES, MARK_REMOVES, MARK_TOUCHES, PARKED, SCAN_CELLS,
    SUPERS_MOST, WIDE_LINES,
};
use pairmask_shaders::layouts::{
    GridLayout, GridLevel, GridParams, SceneMode, SceneParams, SceneSummary,
};
use pairmask_shaders::mirror::grid_layout::{cell, coordinates};
use pairmask_shaders::{ComposedStage, SceneStage, Stage};
use pairmask_tests::gpu::open;
use pairmask_tests::stress_scenes::{self, Rng};
use pairmaskd::execute::gpu::{
    Block, Checks, Command, Frame, Gpu, Home, HostImport, Part, Pipelines, Wait, grid_layout,
};

/// Flags of a record.
const PRESENT: u32 = 1;
const OFF: u32 = 2;
const STATIC: u32 = 4;
const REMOVED: u32 = 8;
const FLAGS: u32 = 0xff;
/// Kinds of an entry, above the index in its name.
const THEN: u32 = 1;
const NOW: u32 = 2;
const KINDS_SHIFT: u32 = 30;
/// Words of the control block.
const ENTRIES: usize = CONTROL_HEADER_WORDS as usize;
const ROWS: usize = ENTRIES + 1;
const MOVED: usize = ENTRIES + 2;
const MOVED_STATIC: usize = ENTRIES + 3;
const SUMS: usize = (CONTROL_HEADER_WORDS + SUPERS_MOST) as usize;

/// What lies in a word that no stage may write.
const UNTOUCHED: u32 = 0xa5a5_a5a5;
/// A history whose number needs both of its words.
const EPOCH: u64 = (5 << 32) + 0xffff_fff0;
/// Longer than any stage takes: a watchdog.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs stages on words.
struct Bench {
    gpu: Arc<Gpu>,
    pipelines: Pipelines,
}

impl Bench {
    fn new() -> Self {
        let gpu = open(HostImport::Never);
        let pipelines = Pipelines::new(&gpu, Checks::On, None).expect("pipelines");
        Self { gpu, pipelines }
    }

    /// The words of all bindings after a stage has run.
    fn run(&self, stage: &ComposedStage, bindings: &[Vec<u32>], groups: u32) -> Vec<Vec<u32>> {
        assert_eq!(bindings.len(), stage.binding_count as usize);
        let blocks: Vec<Arc<Block>> = bindings
            .iter()
            .map(|words| {
                let bytes = (4 * words.len()).max(16) as u64;
                let block = Block::new(&self.gpu, Home::Host, bytes).expect("memory");
                block.write(0, words);
                block
            })
            .collect();
        let pipeline = self.pipelines.compile(stage).expect("a stage");
        let mut frame = Frame::new(&self.gpu, false).expect("a frame");
        let parts = blocks.iter().zip(bindings);
        let part = |(block, words): (&Arc<Block>, &Vec<u32>)| {
            Part::of(block, 0, (4 * words.len()).max(16) as u64)
        };
        let step = Command::Stage {
            pipeline,
            parts: parts.map(part).collect(),
            immediates: bytemuck::bytes_of(&GridParams::default()).to_vec(),
            groups: [groups, 1],
        };
        frame.record(vec![step]).expect("a recording");
        frame.run(Wait::Block, PATIENCE).expect("a run");
        let read = |(block, words): (&Arc<Block>, &Vec<u32>)| {
            let mut after = vec![0; words.len()];
            block.read(0, &mut after);
            after
        };
        blocks.iter().zip(bindings).map(read).collect()
    }
}

fn composed(stage: SceneStage) -> ComposedStage {
    Stage::Scene(stage).composed().expect("the stage's text")
}

/// The stage with a piece of its text replaced, which must be there.
fn altered(stage: SceneStage, from: &str, to: &str) -> ComposedStage {
    let stage = composed(stage);
    assert_eq!(stage.wgsl.matches(from).count(), 1, "'{from}' in {}", stage.label);
    ComposedStage { wgsl: stage.wgsl.replace(from, to), ..stage }
}

/// Compares bindings word by word.
fn same(got: &[Vec<u32>], expected: &[Vec<u32>]) -> Result<(), String> {
    for (binding, (got, expected)) in got.iter().zip(expected).enumerate() {
        if let Some(word) = (0..expected.len()).find(|i| got.get(*i) != expected.get(*i)) {
            let (got, expected) = (got.get(word), expected[word]);
            return Err(format!("binding {binding}, word {word}: {got:x?} for {expected:x}"));
        }
    }
    Ok(())
}

/// A record: keys of a box, the history in which it changed, flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Record {
    keys: KeyBox,
    epoch: u64,
    flags: u32,
}

impl Record {
    fn words(&self) -> [u32; 8] {
        let KeyBox { min, max } = self.keys;
        let [a, b, c, d, e, f] = [min[0], min[1], min[2], max[0], max[1], max[2]].map(|k| k as u32);
        [a, b, c, d, e, f, self.epoch as u32, ((self.epoch >> 32) as u32) << 8 | self.flags]
    }

    const fn has_changed(&self) -> bool {
        self.epoch == EPOCH
    }

    /// What collides.
    fn colliding(&self) -> Option<KeyBox> {
        let is_on = self.flags & (PRESENT | OFF) == PRESENT;
        (is_on && self.keys != KeyBox::NOTHING).then_some(self.keys)
    }
}

/// The records of a scene.
#[derive(Clone)]
struct Scene {
    now: Vec<Record>,
    then: Vec<Record>,
    named: Vec<u32>,
}

fn words_of(records: &[Record]) -> Vec<u32> {
    records.iter().flat_map(Record::words).collect()
}

fn odd_box(random: &mut Rng) -> Option<Aabb> {
    let all = f32::INFINITY;
    Some(match random.below(40) {
        0 => Aabb::EMPTY,
        1 => Aabb { min: [f32::NAN, 0.0, 0.0], max: [1.0; 3] },
        2 => Aabb { min: [-all; 3], max: [all; 3] },
        3 => Aabb { min: [-0.0; 3], max: [0.0; 3] },
        4 => Aabb { min: [1e-45; 3], max: [2e-40; 3] },
        5 => Aabb { min: [-300.0, 0.0, 0.0], max: [300.0, 4.0, 4.0] },
        6 => Aabb { min: [0.0; 3], max: [5.0; 3] },
        _ => return None,
    })
}

impl Scene {
    /// Boxes of a uniform scene, few odd ones among them; one in three has changed.
    fn new(slots: u32, random: &mut Rng) -> (Self, Vec<Aabb>) {
        let uniform = stress_scenes::named("uniform");
        let boxes: Vec<Aabb> = uniform.boxes(slots, u64::from(random.below(1 << 20)));
        let record = |b: &Aabb, shift: f32, random: &mut Rng| {
            let moved = Aabb { min: b.min.map(|x| x + shift), max: b.max.map(|x| x + shift) };
            let of = odd_box(random).unwrap_or(moved);
            let epoch = match random.below(6) {
                0 | 1 => EPOCH,
                // Differs in one of the two words.
                2 => EPOCH - (1 << 32),
                3 => EPOCH - 1,
                _ => u64::from(random.below(7)),
            };
            let some = |flag, one_in, random: &mut Rng| flag * u32::from(random.below(one_in) == 0);
            let flags = (PRESENT * u32::from(random.below(9) > 0))
                | some(OFF, 9, random)
                | some(STATIC, 4, random)
                | some(REMOVED, 5, random);
            Record { keys: KeyBox::classify(&of).0, epoch, flags }
        };
        let now = boxes.iter().map(|b| record(b, 0.0, random)).collect();
        // Some are where they were, some near, some have left their place.
        let shifts = [0.0, 0.3, 40.0];
        let mut then = Vec::new();
        for b in &boxes {
            let shift = shifts[random.below(3) as usize];
            then.push(record(b, shift, random));
        }
        let named = (0..slots).map(|_| random.below(9)).collect();
        (Self { now, then, named }, boxes)
    }

    /// A record changes: as it was is kept, if this is its first change of the history.
    fn change(&mut self, index: usize, keys: KeyBox, mut flags: u32) {
        let record = self.now[index];
        if !record.has_changed() {
            self.then[index] = record;
            flags &= !REMOVED;
        }
        self.now[index] = Record { keys, epoch: EPOCH, flags };
    }
}

fn params(scene: &Scene) -> SceneParams {
    SceneParams {
        slots: scene.now.len() as u32,
        epoch_low: EPOCH as u32,
        epoch_high: (EPOCH >> 32) as u32,
        thread_rounds: u32::MAX,
        rows_together: 4,
        ..SceneParams::default()
    }
}

fn raw<T: bytemuck::Pod>(value: &T) -> Vec<u32> {
    bytemuck::cast_slice(bytemuck::bytes_of(value)).to_vec()
}

/// An edit that sets boxes; the words before it, and those that it leaves behind.
fn applied(slots: u32, seed: u64) -> (Vec<Vec<u32>>, Vec<Vec<u32>>) {
    let random = &mut Rng::new(seed);
    let (mut scene, boxes) = Scene::new(slots, random);
    let is_range = random.below(2) == 0;
    let first = random.below(slots);
    // Indices beyond the records are passed over, whoever wrote them.
    let indices: Vec<u32> = if is_range {
        (first..first + random.below(slots - first + 3)).collect()
    } else {
        (0..slots + 3).filter(|_| random.below(3) == 0).collect()
    };
    let set: Vec<Aabb> = indices
        .iter()
        .map(|i| match (odd_box(random), random.below(3)) {
            (Some(odd), _) => odd,
            // The very same box, as far as the record has one.
            (None, 0) if *i < slots => scene.now[*i as usize].keys.to_box(),
            _ => boxes[random.below(slots) as usize],
        })
        .collect();
    let naming = random.below(2) * 77;
    let (table_words, filter_words, control_words) = (1_024, 64, 40);
    let params = SceneParams {
        set_count: set.len() as u32,
        set_first: if is_range { first } else { 0 },
        set_is_range: u32::from(is_range),
        naming,
        table_words,
        filter_words,
        control_words,
        ..params(&scene)
    };
    let list = if is_range { vec![UNTOUCHED; 4] } else { [&indices[..], &[UNTOUCHED]].concat() };
    let box_words: Vec<u32> = bytemuck::cast_slice::<Aabb, u32>(&set).to_vec();
    let bindings = |scene: &Scene, table: Vec<u32>, control: Vec<u32>| {
        let (now, then) = (words_of(&scene.now), words_of(&scene.then));
        let boxes = [&box_words[..], &[UNTOUCHED; 4]].concat();
        vec![boxes, raw(&params), list.clone(), now, then, scene.named.clone(), table, control]
    };
    let zeroed = (table_words + filter_words) as usize;
    let dirty = |zeroed: usize| [vec![0; zeroed], vec![UNTOUCHED; 16]].concat();
    let before = bindings(&scene, vec![UNTOUCHED; zeroed + 16], vec![UNTOUCHED; 56]);
    for (index, b) in indices.iter().zip(&set).filter(|(index, _)| **index < slots) {
        let index = *index as usize;
        if naming != 0 {
            scene.named[index] = naming;
        }
        let (old, keys) = (scene.now[index], KeyBox::classify(b).0);
        if old.flags & PRESENT == 0 || old.keys != keys {
            scene.change(index, keys, old.flags | PRESENT);
        }
    }
    let after = bindings(&scene, dirty(zeroed), dirty(control_words as usize));
    (before, after)
}

/// Sizes around a batch, and some of several.
const SIZES: [u32; 10] = [1, 2, 31, 70, 255, 256, 257, 700, 1_234, 3_001];

/// Runs a stage over sizes and seeds, and compares.
fn check(
    bench: &Bench,
    stage: &ComposedStage,
    case: impl Fn(u32, u64) -> (Vec<Vec<u32>>, Vec<Vec<u32>>),
) -> Result<(), String> {
    for (seed, slots) in (1..).zip(SIZES.into_iter().cycle().take(2 * SIZES.len())) {
        let (before, expected) = case(slots, seed);
        let got = bench.run(stage, &before, 1 + seed as u32 % 3);
        same(&got, &expected).map_err(|e| format!("{slots} indices, seed {seed}: {e}"))?;
    }
    Ok(())
}

#[test]
fn boxes_that_are_set_change_their_records_and_no_other_word() {
    let bench = Bench::new();
    check(&bench, &composed(SceneStage::Apply), applied).unwrap_or_else(|e| panic!("{e}"));
    for (from, to) in [
        ("if (index >= params.slots) {", "if (false) {"),
        ("named[index] = params.naming;", "named[index] = 1u;"),
        ("if (!has_changed(b)) {", "if (true) {"),
        ("flags &= ~REMOVED;", ""),
        ("(params.table_words + params.filter_words) / 4u", "params.table_words / 4u"),
        ("control[i] = 0u;", ""),
        ("batch += groups.x) {", "batch += 4u * groups.x) {"),
    ] {
        let stage = altered(SceneStage::Apply, from, to);
        assert!(check(&bench, &stage, applied).is_err(), "'{to}' for '{from}' is not noticed");
    }
}

/// An edit that removes, switches, flags and gives filter data; the words before it, and those that it leaves behind.
fn marked(slots: u32, seed: u64) -> (Vec<Vec<u32>>, Vec<Vec<u32>>) {
    let random = &mut Rng::new(seed ^ 0x5eed);
    let (mut scene, _) = Scene::new(slots, random);
    let naming = random.below(2) * 77;
    let mut marks: Vec<[u32; 2]> = Vec::new();
    for index in 0..slots {
        let old = scene.now[index as usize].flags & !REMOVED;
        let mark = match random.below(7) {
            // Other filter data, with flags or without.
            5 => MARK_TOUCHES | MARK_NAMES | old,
            6 => MARK_TOUCHES | (old ^ STATIC),
            0 => MARK_REMOVES,
            // Set anew in the same edit.
            1 => MARK_REMOVES | MARK_NAMES | old,
            2 => MARK_NAMES | old,
            3 => MARK_NAMES | (old ^ [OFF, STATIC][random.below(2) as usize]),
            _ => continue,
        };
        marks.push([index, mark]);
    }
    let params = SceneParams { mark_count: marks.len() as u32, naming, ..params(&scene) };
    let list = [marks.as_flattened(), &[UNTOUCHED; 4]].concat();
    let bindings = |scene: &Scene| {
        let (now, then) = (words_of(&scene.now), words_of(&scene.then));
        vec![raw(&params), list.clone(), now, then, scene.named.clone()]
    };
    let before = bindings(&scene);
    for [index, mark] in &marks {
        let index = *index as usize;
        if naming != 0 && mark & MARK_NAMES != 0 {
            scene.named[index] = naming;
        }
        let old = scene.now[index];
        let removes = mark & (MARK_REMOVES | MARK_TOUCHES) != 0;
        if removes || old.flags & !REMOVED != mark & FLAGS {
            scene.change(index, old.keys, (mark & FLAGS) | (old.flags & REMOVED));
            scene.now[index].flags |= REMOVED * u32::from(removes);
        }
    }
    (before, bindings(&scene))
}

#[test]
fn boxes_that_are_removed_or_flagged_change_their_records_and_no_other_word() {
    let bench = Bench::new();
    check(&bench, &composed(SceneStage::Mark), marked).unwrap_or_else(|e| panic!("{e}"));
    for (from, to) in [
        ("&& (mark & MARK_NAMES) != 0u", ""),
        ("if (!removes && ", "if ("),
        ("(MARK_REMOVES | MARK_TOUCHES)", "MARK_REMOVES"),
        ("then[2u * index] = now[2u * index];", ""),
        ("| (old & REMOVED);", ";"),
        ("flags |= REMOVED;", ""),
        ("i < params.mark_count;", "i + 1u < params.mark_count;"),
    ] {
        let stage = altered(SceneStage::Mark, from, to);
        assert!(check(&bench, &stage, marked).is_err(), "'{to}' for '{from}' is not noticed");
    }
}

/// An entry of the grid: name, cell, level.
type Entry = [u32; 3];

/// A search: its words before `scene_cells`, and what that has to leave behind.
struct Search {
    before: Vec<Vec<u32>>,
    params: SceneParams,
    /// Cells, filter and rows.
    table: Vec<u32>,
    /// Control block.
    control: Vec<u32>,
    /// In any order.
    entries: Vec<Entry>,
    /// What each entry stands for.
    boxes: Vec<(Entry, KeyBox)>,
    /// What collides of each record.
    colliding: Vec<Option<KeyBox>>,
}

fn spans(level: &GridLevel, [low, high]: [[f32; 3]; 2]) -> ([i32; 3], [i32; 3]) {
    let first = std::array::from_fn(|axis| cell(level, axis, low[axis]));
    (first, std::array::from_fn(|axis| cell(level, axis, high[axis]) - first[axis]))
}

fn hull(a: &KeyBox, b: &KeyBox) -> KeyBox {
    KeyBox {
        min: std::array::from_fn(|x| a.min[x].min(b.min[x])),
        max: std::array::from_fn(|x| a.max[x].max(b.max[x])),
    }
}

impl Search {
    fn new(slots: u32, seed: u64) -> Self {
        let modes = [SceneMode::Changes, SceneMode::Moved, SceneMode::All, SceneMode::Query];
        let mode = modes[Rng::new(seed ^ 0x30de).below(4) as usize];
        Self::of_mode(slots, seed, mode)
    }

    fn of_mode(slots: u32, seed: u64, mode: SceneMode) -> Self {
        let random = &mut Rng::new(seed ^ 0xce11);
        let (scene, boxes) = Scene::new(slots, random);
        let mut layout = grid_layout(BoxSlice::from(boxes.as_slice()));
        if seed.is_multiple_of(3) {
            // The boxes of the coarsest level are giants then.
            layout.level_count = (layout.level_count - 1).max(1);
        }
        layout.first_nothing = layout.first_giant + slots / PARKED + 1;
        layout.cell_end = layout.first_nothing;
        let is_dense = match mode {
            SceneMode::All => true,
            SceneMode::Query => false,
            SceneMode::Changes | SceneMode::Moved => random.below(3) == 0,
        };
        let sums = (layout.cell_end + 1).div_ceil(SCAN_CELLS);
        let (table_words, filter_words) = (sums * SCAN_CELLS, 1_024);
        let control_words = SUMS as u32 + sums;
        let params = SceneParams {
            control_words,
            mode: mode as u32,
            // In a search of queries that are entries, those from there on.
            set_first: slots - slots / 3,
            dense: u32::from(is_dense),
            naming: 5,
            entry_capacity: 2 * slots,
            table_words,
            filter_words,
            ..params(&scene)
        };
        let row_words = (slots.next_multiple_of(BATCH_BOXES) / 32) as usize;
        let table = vec![0; (table_words + filter_words) as usize + row_words];
        let control = vec![0; control_words as usize];
        let mut search = Self {
            before: Vec::new(),
            params,
            table,
            control,
            entries: Vec::new(),
            boxes: Vec::new(),
            colliding: scene.now.iter().map(Record::colliding).collect(),
        };
        let mut dirty = search.table.clone();
        dirty[(table_words + filter_words) as usize..].fill(UNTOUCHED);
        search.before = vec![
            raw(&params),
            raw(&layout),
            words_of(&scene.now),
            words_of(&scene.then),
            scene.named.clone(),
            dirty,
            search.control.clone(),
            vec![UNTOUCHED; 8 * slots as usize],
        ];
        search.find(&scene, &layout, mode, is_dense);
        search
    }

    fn find(&mut self, scene: &Scene, layout: &GridLayout, mode: SceneMode, is_dense: bool) {
        for (index, record) in scene.now.iter().enumerate() {
            let is = record.colliding();
            if mode == SceneMode::Changes && record.has_changed() {
                if record.flags & (PRESENT | OFF) == PRESENT {
                    self.control[MOVED] += 1;
                    self.control[MOVED_STATIC] += u32::from(record.flags & STATIC != 0);
                }
                match (scene.then[index].colliding(), is) {
                    (Some(was), Some(is)) if was.overlaps(&is) => {
                        self.enter(layout, index, THEN | NOW, hull(&was, &is));
                    }
                    (was, is) => {
                        if let Some(was) = was {
                            self.enter(layout, index, THEN, was);
                        }
                        if let Some(is) = is {
                            self.enter(layout, index, NOW, is);
                        }
                    }
                }
                continue;
            }
            let Some(is) = is else { continue };
            let is_named = match mode {
                SceneMode::Moved => scene.named[index] == self.params.naming,
                SceneMode::Query => index >= self.params.set_first as usize,
                SceneMode::Changes | SceneMode::All => false,
            };
            let both = mode == SceneMode::Changes || is_named;
            let kinds = if both { THEN | NOW } else { NOW };
            if is_dense || is_named || is_wide(layout, &is) {
                self.control[MOVED] += u32::from(mode == SceneMode::Query && !is_named);
                self.enter(layout, index, kinds, is);
            } else {
                let rows = (self.params.table_words + self.params.filter_words) as usize;
                self.table[rows + index / 32] |= 1 << (index % 32);
                self.control[ROWS] += 1;
            }
        }
    }

    fn enter(&mut self, layout: &GridLayout, index: usize, kinds: u32, keys: KeyBox) {
        let level = level_of(layout, &keys);
        let mut home = layout.first_giant + index as u32 / PARKED;
        if level < layout.level_count {
            let of = &layout.levels[level as usize];
            let (first, span) = spans(of, coordinates(&keys));
            let [x, y, z]: [u32; 3] =
                std::array::from_fn(|axis| (first[axis] & of.fold[axis]) as u32);
            home = of.first_cell + (z * of.count[1] + y) * of.count[0] + x;
            if self.params.dense == 0 {
                for dz in -1..=span[2] {
                    for dy in -1..=span[1] {
                        for dx in -1..=span[0] {
                            self.filter(level, [first[0] + dx, first[1] + dy, first[2] + dz]);
                        }
                    }
                }
            }
        }
        self.table[home as usize] += 1;
        self.control[SUMS + (home / SCAN_CELLS) as usize] += 1;
        self.control[ENTRIES] += 1;
        let entry = [kinds << KINDS_SHIFT | index as u32, home, level];
        self.entries.push(entry);
        self.boxes.push((entry, keys));
    }

    /// Sets the bit of a cell, whose neighbours along x are neighbouring bits.
    fn filter(&mut self, level: u32, [x, y, z]: [i32; 3]) {
        let hash = (x as u32)
            .wrapping_add((y as u32).wrapping_mul(0x9e37_79b1))
            .wrapping_add((z as u32).wrapping_mul(0x85eb_ca77))
            .wrapping_add(level.wrapping_mul(0xc2b2_ae3d));
        let bit = hash % (32 * self.params.filter_words);
        self.table[(self.params.table_words + bit / 32) as usize] |= 1 << (bit % 32);
    }

    /// Compares what `scene_cells` left behind.
    fn check_cells(&self, got: &[Vec<u32>]) -> Result<(), String> {
        same(&got[..5], &self.before[..5])?;
        same(&got[5..7], &[self.table.clone(), self.control.clone()])?;
        let (found, rest) = got[7].split_at(4 * self.entries.len());
        if rest.iter().any(|word| *word != UNTOUCHED) {
            return Err("words behind the entries".to_owned());
        }
        let sorted = |mut entries: Vec<Entry>| {
            entries.sort_unstable();
            entries
        };
        let found: &[[u32; 4]] = found.as_chunks().0;
        let names =
            sorted(found.iter().map(|[name, cell, _, level]| [*name, *cell, *level]).collect());
        let expected = sorted(self.entries.clone());
        if let Some(at) = (0..names.len()).find(|at| names[*at] != expected[*at]) {
            return Err(format!("entry {:x?} for {:x?}", names[at], expected[at]));
        }
        // The slots of a cell are those below its count, each once.
        let mut slots: Vec<[u32; 2]> =
            found.iter().map(|[_, cell, slot, _]| [*cell, *slot]).collect();
        slots.sort_unstable();
        let (mut last, mut next) = (u32::MAX, 0);
        for [cell, slot] in slots {
            next = if cell == last { next + 1 } else { 0 };
            last = cell;
            if slot != next {
                return Err(format!("cell {cell}: slot {slot} for {next}"));
            }
        }
        Ok(())
    }
}

fn level_of(layout: &GridLayout, keys: &KeyBox) -> u32 {
    let fits = |l: &u32| {
        let (_, span) = spans(&layout.levels[*l as usize], coordinates(keys));
        span.iter().all(|cells| *cells <= 1)
    };
    (0..layout.level_count).find(fits).unwrap_or(layout.level_count)
}

fn is_wide(layout: &GridLayout, keys: &KeyBox) -> bool {
    let level = level_of(layout, keys);
    let lines = |l: u32| {
        let (_, [_, y, z]) = spans(&layout.levels[l as usize], coordinates(keys));
        (y + 2) as f32 * (z + 2) as f32
    };
    level == layout.level_count || (0..level).map(lines).sum::<f32>() > WIDE_LINES as f32
}

fn check_cells(bench: &Bench, stage: &ComposedStage) -> Result<(), String> {
    for (seed, slots) in (1..).zip(SIZES.into_iter().cycle().take(4 * SIZES.len())) {
        let search = Search::new(slots, seed);
        let got = bench.run(stage, &search.before, 1 + seed as u32 % 3);
        search.check_cells(&got).map_err(|e| format!("{slots} indices, seed {seed}: {e}"))?;
    }
    Ok(())
}

#[test]
fn records_become_entries_of_their_cells_or_rows() {
    let bench = Bench::new();
    check_cells(&bench, &composed(SceneStage::Cells)).unwrap_or_else(|e| panic!("{e}"));
    for (from, to) in [
        ("all(spans <= vec3<i32>(1))", "all(spans <= vec3<i32>(2))"),
        ("return lines > f32(WIDE_LINES);", "return false;"),
        ("for (var z = -1; z <= spans.z; z++) {", "for (var z = 0; z <= spans.z; z++) {"),
        ("let rest = (run >> 1u) >> (31u - bit % 32u);", "let rest = 0u;"),
        ("atomicAdd(&control[SUMS + cell / SCAN_CELLS], 1u);", ""),
        ("overlap(was, is)) {", "true) {"),
        ("first = entry(index, THEN, was);", "first = entry(index, NOW, was);"),
        ("if (is.is_static) {", "if (!is.is_static) {"),
        ("&& named[index] == params.naming) {", ") {"),
        ("&& index >= params.set_first) {", ") {"),
        ("if (params.mode == MODE_QUERY && !is_entry) {", "if (false) {"),
        ("atomicAdd(&row_count, countOneBits(bits));", "atomicAdd(&row_count, 1u);"),
        ("entries[entry_base + at + 1u] = second;", "entries[entry_base + at + 1u] = first;"),
    ] {
        let stage = altered(SceneStage::Cells, from, to);
        assert!(check_cells(&bench, &stage).is_err(), "'{to}' for '{from}' is not noticed");
    }
}

#[test]
fn entries_without_room_are_counted_and_not_written() {
    let bench = Bench::new();
    let mut search = Search::new(700, 3);
    let count = search.entries.len() as u32;
    search.params.entry_capacity = count / 2;
    search.before[0] = raw(&search.params);
    let got = bench.run(&composed(SceneStage::Cells), &search.before, 2);
    assert_eq!(got[6][ENTRIES], count);
    let behind = &got[7][4 * (count / 2) as usize..];
    assert!(count > 20 && behind.iter().all(|word| *word == UNTOUCHED));
    let placed = place(&bench, &composed(SceneStage::Place), &search, &got);
    assert!(placed[6].iter().all(|word| *word == UNTOUCHED), "too few entries are not placed");
}

/// Runs `scene_place` on what `scene_cells` left behind, its counts added up.
fn place(
    bench: &Bench,
    stage: &ComposedStage,
    search: &Search,
    cells: &[Vec<u32>],
) -> Vec<Vec<u32>> {
    let mut table = cells[5].clone();
    let mut first = 0;
    for cell in &mut table[..search.params.table_words as usize] {
        first += std::mem::replace(cell, first);
    }
    let before = vec![
        cells[0].clone(),
        cells[2].clone(),
        cells[3].clone(),
        table,
        cells[6].clone(),
        cells[7].clone(),
        vec![UNTOUCHED; 8 * (search.entries.len() + 2)],
    ];
    let after = bench.run(stage, &before, 2);
    same(&after[..6], &before[..6]).expect("what it reads");
    after
}

fn check_place(bench: &Bench, stage: &ComposedStage) -> Result<(), String> {
    let cells_stage = composed(SceneStage::Cells);
    for (seed, slots) in (1..).zip(SIZES.into_iter().cycle().take(3 * SIZES.len())) {
        let search = Search::new(slots, seed);
        let cells = bench.run(&cells_stage, &search.before, 2);
        let placed = place(bench, stage, &search, &cells);
        let (sorted, rest) = placed[6].split_at(8 * search.entries.len());
        let key = |i: usize| sorted[i] as i32;
        let mut got: Vec<(u32, Entry, KeyBox)> = Vec::new();
        for at in (0..sorted.len()).step_by(8) {
            let min = [key(at), key(at + 1), key(at + 2)];
            let max = [key(at + 3), key(at + 4), key(at + 5)];
            let (name, level) = (sorted[at + 6], sorted[at + 7]);
            let entry = search.entries.iter().find(|[n, _, _]| *n == name);
            let Some([_, cell, _]) = entry else {
                return Err(format!("{slots} indices, seed {seed}: name {name:x}"));
            };
            got.push((*cell, [name, *cell, level], KeyBox { min, max }));
        }
        if !got.is_sorted_by_key(|(cell, ..)| *cell) {
            return Err(format!("{slots} indices, seed {seed}: cells are not in order"));
        }
        let mut expected: Vec<(Entry, KeyBox)> = search.boxes.clone();
        let mut got: Vec<(Entry, KeyBox)> = got.into_iter().map(|(_, e, b)| (e, b)).collect();
        expected.sort_unstable_by_key(|(entry, _)| *entry);
        got.sort_unstable_by_key(|(entry, _)| *entry);
        if got != expected || rest.iter().any(|word| *word != UNTOUCHED) {
            return Err(format!("{slots} indices, seed {seed}: boxes"));
        }
    }
    Ok(())
}

#[test]
fn entries_come_to_the_places_of_their_cells() {
    let bench = Bench::new();
    check_place(&bench, &composed(SceneStage::Place)).unwrap_or_else(|e| panic!("{e}"));
    for (from, to) in [
        ("here = was;", ""),
        ("here = hull(was, here);", "here = was;"),
        ("table[one.y] + one.z;", "i;"),
        ("bitcast<vec2<i32>>(one.xw)", "bitcast<vec2<i32>>(one.xz)"),
    ] {
        let stage = altered(SceneStage::Place, from, to);
        assert!(check_place(&bench, &stage).is_err(), "'{to}' for '{from}' is not noticed");
    }
}

/// Queries around the boxes of a scene, odd ones among them.
fn some_queries(count: u32, random: &mut Rng) -> Vec<Aabb> {
    let boxes: Vec<Aabb> =
        stress_scenes::named("uniform").boxes(count, u64::from(random.below(1 << 20)));
    boxes.iter().map(|b| odd_box(random).unwrap_or(*b)).collect()
}

/// Pairs of a query and a box, in order.
fn queried(search: &Search, queries: &[Aabb]) -> Vec<[u32; 2]> {
    let mut pairs = Vec::new();
    for (number, query) in queries.iter().enumerate() {
        let keys = KeyBox::classify(query).0;
        for (index, b) in search.colliding.iter().enumerate() {
            if b.as_ref().is_some_and(|b| keys.overlaps(b)) {
                pairs.push([number as u32, index as u32]);
            }
        }
    }
    pairs
}

/// The same of queries that are records behind those of the scene.
fn queried_records(search: &Search) -> Vec<[u32; 2]> {
    let (boxes, queries) = search.colliding.split_at(search.params.set_first as usize);
    let mut pairs = Vec::new();
    for (number, query) in queries.iter().enumerate() {
        for (index, b) in boxes.iter().enumerate() {
            if let (Some(query), Some(b)) = (query, b)
                && query.overlaps(b)
            {
                pairs.push([number as u32, index as u32]);
            }
        }
    }
    pairs
}

/// What a stage of queries reads and writes: the grid, `of_stage` (queries, or records), a count for each query, and
/// room for so many pairs.
fn query_bindings(
    params: &SceneParams,
    cells: &[Vec<u32>],
    placed: &[Vec<u32>],
    [of_stage, counts]: [Vec<u32>; 2],
    room: usize,
) -> Vec<Vec<u32>> {
    vec![
        raw(params),
        cells[1].clone(),
        placed[3].clone(),
        placed[6].clone(),
        of_stage,
        counts,
        cells[6].clone(),
        vec![UNTOUCHED; 2 * room + 8],
        vec![UNTOUCHED; size_of::<SceneSummary>() / 4],
    ]
}

/// Checks `scene_query`, or `scene_query_rows`: queries that are records behind those of the scene.
fn check_query(bench: &Bench, stage: &ComposedStage, are_entries: bool) -> Result<(), String> {
    let [cells_stage, place_stage] = [SceneStage::Cells, SceneStage::Place].map(composed);
    for (seed, slots) in (1..).zip(SIZES.into_iter().cycle().take(2 * SIZES.len())) {
        let mode = if are_entries { SceneMode::Query } else { SceneMode::All };
        let search = Search::of_mode(slots, seed, mode);
        let mut queries = some_queries(1 + slots / 3, &mut Rng::new(seed ^ 0x9e7));
        let mut expected = queried(&search, &queries);
        if are_entries {
            queries.truncate((slots / 3) as usize);
            expected = queried_records(&search);
        }
        let cells = bench.run(&cells_stage, &search.before, 2);
        let placed = place(bench, &place_stage, &search, &cells);
        // Once without room for all.
        let room = if seed % 5 == 0 { expected.len() / 2 } else { expected.len() + 3 };
        let query_count = queries.len() as u32;
        let params =
            SceneParams { pair_capacity: room as u32, budget: 1, query_count, ..search.params };
        // Counts go up from zero, or are written.
        let (of_stage, count) = if are_entries {
            (cells[2].clone(), 0)
        } else {
            (bytemuck::cast_slice(&queries).to_vec(), UNTOUCHED)
        };
        let of_stage = [of_stage, vec![count; queries.len() + 5]];
        let before = query_bindings(&params, &cells, &placed, of_stage, room);
        let after = bench.run(stage, &before, 1 + seed as u32 % 3);
        let what = |what: &str| format!("{slots} records, seed {seed}: {what}");
        same(&after[..5], &before[..5]).map_err(|e| what(&e))?;
        let count = after[8][0] as usize;
        if count != expected.len() {
            return Err(what(&format!("{count} pairs for {}", expected.len())));
        }
        let (counts, behind) = after[5].split_at(queries.len());
        let is_counted = (0..).zip(counts).all(|(query, count)| {
            *count as usize == expected.iter().filter(|pair| pair[0] == query).count()
        });
        if !is_counted || behind != &before[5][queries.len()..] {
            return Err(what("counts of queries"));
        }
        let (found, rest) = after[7].split_at(2 * room.min(count));
        let mut found: Vec<[u32; 2]> = found.as_chunks().0.to_vec();
        found.sort_unstable();
        let is_right = if room < count {
            found.windows(2).all(|two| two[0] < two[1])
                && found.iter().all(|pair| expected.binary_search(pair).is_ok())
        } else {
            found == expected
        };
        if !is_right || rest.iter().any(|word| *word != UNTOUCHED) {
            return Err(what("pairs"));
        }
    }
    Ok(())
}

#[test]
fn queries_find_the_boxes_that_they_overlap() {
    let bench = Bench::new();
    check_query(&bench, &composed(SceneStage::Query), false).unwrap_or_else(|e| panic!("{e}"));
    for (from, to) in [
        ("atomicAdd(&pair_counts[own], 1u);", ""),
        ("tell(vec2<u32>(number, bitcast<u32>(b.z) & INDEX_MASK));", ""),
        ("number = first + own;", "number = own;"),
        ("bitcast<u32>(b.z) & INDEX_MASK", "bitcast<u32>(b.z)"),
        ("all(row_lo.yz <= b.xy)", "all(row_lo.yz < b.xy)"),
        ("line += QUERY_LANES", "line += 2u * QUERY_LANES"),
        (
            "test_run(table[grid.first_giant] + share",
            "test_run(table[grid.first_giant] + share + 1u",
        ),
        ("return !is_invalid && all(row_lo <= row_hi);", "return true;"),
        ("first = select(max(first, vec3<i32>(0)), first, wraps);", "first = low;"),
    ] {
        let stage = altered(SceneStage::Query, from, to);
        assert!(check_query(&bench, &stage, false).is_err(), "'{to}' for '{from}' is not noticed");
    }
}

#[test]
fn boxes_find_the_queries_that_are_entries() {
    let bench = Bench::new();
    let stage = composed(SceneStage::QueryRows);
    check_query(&bench, &stage, true).unwrap_or_else(|e| panic!("{e}"));
    for (from, to) in [
        ("return is_query(one_name) != is_query(other_name);", "return true;"),
        ("return atomicLoad(&control[MOVED]) != 0u;", "return false;"),
        ("query - params.set_first", "query"),
        ("atomicAdd(&counts[number], 1u);", ""),
        ("select(other_name, one_name, is_first)", "one_name"),
        ("select(one_name, other_name, is_first)", "other_name"),
        ("all(row_lo.yz <= b.xy)", "all(row_lo.yz < b.xy)"),
        ("levels = levels_to_look_at();", "levels = 0u;"),
        ("first = select(max(first, vec3<i32>(0)), first, wraps);", "first = low;"),
    ] {
        let stage = altered(SceneStage::QueryRows, from, to);
        assert!(check_query(&bench, &stage, true).is_err(), "'{to}' for '{from}' is not noticed");
    }
}

/// In both ways of queries; entries of an edit take the same way as records that are queries.
#[test]
fn a_search_with_more_rounds_than_a_thread_may_have_is_too_much() {
    let bench = Bench::new();
    let [cells_stage, place_stage] = [SceneStage::Cells, SceneStage::Place].map(composed);
    let everything = Aabb { min: [-1e6; 3], max: [1e6; 3] };
    for (stage, mode) in
        [(SceneStage::Query, SceneMode::All), (SceneStage::QueryRows, SceneMode::Query)]
    {
        let search = Search::of_mode(700, 4, mode);
        let cells = bench.run(&cells_stage, &search.before, 2);
        let placed = place(&bench, &place_stage, &search, &cells);
        for (thread_rounds, is_too_much) in [(3_000, false), (40, true)] {
            let params = SceneParams {
                pair_capacity: 1_000,
                budget: 9,
                query_count: 1,
                thread_rounds,
                ..search.params
            };
            let of_stage = if stage == SceneStage::Query {
                bytemuck::cast_slice(&[everything]).to_vec()
            } else {
                cells[2].clone()
            };
            let of_stage = [of_stage, vec![UNTOUCHED; 710]];
            let before = query_bindings(&params, &cells, &placed, of_stage, 1_000);
            let after = bench.run(&composed(stage), &before, 1);
            // The high word of the tests.
            let is_said = after[8][5] >= params.budget;
            assert_eq!(is_said, is_too_much, "{stage:?}, {thread_rounds}");
        }
    }
}

#[test]
fn flags_and_words_are_those_of_the_stages() {
    let text = composed(SceneStage::Cells).wgsl;
    for (name, value) in [
        ("PRESENT", PRESENT),
        ("OFF", OFF),
        ("STATIC", STATIC),
        ("REMOVED", REMOVED),
        ("THEN", THEN),
        ("NOW", NOW),
        ("KINDS_SHIFT", KINDS_SHIFT),
    ] {
        assert!(text.contains(&format!("const {name}: u32 = {value}u;")), "{name}");
    }
    assert_eq!(order_key(0.0f32.to_bits()), 0);
}
