//! Boxes in every form as the GPU reads them: the first stages against the library's conversion to
//! f32, pattern by pattern, and whole frames against the modes' definitions.

use std::sync::Arc;
use std::time::Duration;

use bytemuck::{Pod, Zeroable, bytes_of};
use pairmask_core::aabb::KeyBox;
use pairmask_shaders::constants::{BATCH_BOXES, NO_LEVEL, PADDING, UNPLACED_A_CELL};
use pairmask_shaders::layouts::{BatchReport, BatchTotals, GridLayout, GridTotals, KeysParams};
use pairmask_shaders::{Found, GridStage, Rules, Stage};
use pairmask_tests::gpu::{self, open};
use pairmask_tests::naive_modes;
use pairmask_tests::prelude::*;
use pairmask_tests::stress_scenes::{Rng, StressScene};
use pairmaskd::execute::gpu::{
    Block, Capacity, Checks, Command, EngineOptions, Frame, Gpu, Home, HostImport, Part, Pipelines,
    Sizes, Upload,
};

/// A watchdog, no measure of speed.
const TIMEOUT: Duration = Duration::from_secs(120);

#[derive(Clone, Debug, PartialEq)]
struct Seen {
    keys: Vec<KeyBox>,
    invalid: Vec<bool>,
    empty: u32,
}

impl Seen {
    fn expected(boxes: BoxSlice<'_>) -> Self {
        let expanded = (0..boxes.len()).filter_map(|i| boxes.get(i));
        let classified: Vec<_> = expanded.map(|b| KeyBox::classify(&b)).collect();
        let of = |class: BoxClass| classified.iter().map(move |(_, c)| *c == class);
        Self {
            keys: classified.iter().map(|(keys, _)| *keys).collect(),
            invalid: of(BoxClass::Invalid).collect(),
            empty: of(BoxClass::Empty).map(u32::from).sum(),
        }
    }

    /// The first box that differs, or the number of boxes where only a count does.
    fn first_difference(&self, other: &Self) -> Option<usize> {
        let boxes = |seen: &Self| -> Vec<_> {
            seen.keys.iter().copied().zip(seen.invalid.iter().copied()).collect()
        };
        let (a, b) = (boxes(self), boxes(other));
        let differs = (0..a.len().max(b.len())).find(|&i| a.get(i) != b.get(i));
        differs.or((self.empty != other.empty).then_some(a.len()))
    }
}

/// A device with the first stages alone.
struct Bench {
    gpu: Arc<Gpu>,
    pipelines: Pipelines,
}

impl Bench {
    fn new(checks: Checks) -> Self {
        let gpu = open(HostImport::IfPossible);
        let pipelines = Pipelines::new(&gpu, checks, None).expect("no pipeline yet");
        Self { gpu, pipelines }
    }

    /// Memory that holds these bytes and junk behind them.
    fn holding(&self, bytes: &[u8], size: u64) -> Arc<Block> {
        let block = Block::new(&self.gpu, Home::Host, size).expect("memory");
        block.write(0, &vec![0xffu8; block.bytes() as usize]);
        block.write(0, bytes);
        block
    }

    fn zeroed(&self, size: u64) -> Arc<Block> {
        self.holding(&vec![0; size as usize], size)
    }

    /// The boxes, bound to the end of the word that the last one ends in.
    fn boxes(&self, boxes: BoxSlice<'_>) -> Part {
        let size = (boxes.as_bytes().len() as u64).next_multiple_of(4);
        Part::of(&self.holding(boxes.as_bytes(), size), 0, size)
    }

    fn run(&mut self, stage: Stage, parts: Vec<Part>, immediates: &impl Pod, groups: u32) {
        let pipeline = self.pipelines.get(stage).expect("compiles");
        let immediates = bytes_of(immediates).to_vec();
        let step = Command::Stage { pipeline, parts, immediates, groups: [groups, 1] };
        let mut frame = Frame::new(&self.gpu, false).expect("a frame");
        frame.record(vec![step]).expect("records");
        frame.run(TIMEOUT).expect("ends");
    }

    /// The output of the stage `keys`.
    fn keys(&mut self, boxes: BoxSlice<'_>) -> Seen {
        let n = boxes.len() as u32;
        let plane_words = n.next_multiple_of(PADDING);
        let batches = plane_words / BATCH_BOXES;
        let planes = self.zeroed(24 * u64::from(plane_words));
        let totals = self.zeroed(u64::from(batches) * size_of::<BatchTotals>() as u64);
        let reports = self.zeroed(u64::from(batches) * size_of::<BatchReport>() as u64);
        let parts = std::iter::once(self.boxes(boxes))
            .chain([&planes, &totals, &reports].map(Part::whole))
            .collect();
        let params = KeysParams { n, plane_words };
        self.run(Stage::Keys(boxes.form()), parts, &params, batches);
        let planes: Vec<i32> = read(&planes, 6 * plane_words as usize);
        let reports: Vec<BatchReport> = read(&reports, batches as usize);
        let key = |plane: usize, i: usize| planes[plane * plane_words as usize + i];
        let keys = |i| KeyBox {
            min: std::array::from_fn(|axis| key(axis, i)),
            max: std::array::from_fn(|axis| key(3 + axis, i)),
        };
        for i in n as usize..plane_words as usize {
            assert_eq!(keys(i), KeyBox::NOTHING, "the planes are filled up");
        }
        let invalid: Vec<u32> = reports.iter().flat_map(|report| report.invalid).collect();
        Seen {
            keys: (0..n as usize).map(keys).collect(),
            invalid: bits(&invalid, n),
            empty: reports.iter().map(|report| report.empty).sum(),
        }
    }

    /// The output of the stage `grid_cells`, on a grid without levels.
    fn cells(&mut self, boxes: BoxSlice<'_>) -> Seen {
        let n = boxes.len() as u32;
        let sizes = Sizes::of(BoxCount::new(n));
        let first_nothing = n / UNPLACED_A_CELL + 1;
        let layout =
            GridLayout { first_nothing, cell_end: 2 * first_nothing, ..GridLayout::zeroed() };
        let layout = self.holding(bytes_of(&layout), size_of::<GridLayout>() as u64);
        let table = self.zeroed(sizes.table_bytes());
        let control = self.zeroed(sizes.control_bytes());
        let records = self.zeroed(sizes.records_bytes());
        let totals = self.zeroed(u64::from(sizes.batches) * size_of::<GridTotals>() as u64);
        let invalid = self.zeroed(u64::from(sizes.plane() / 8));
        let parts = std::iter::once(self.boxes(boxes))
            .chain([&layout, &table, &control, &records, &totals, &invalid].map(Part::whole))
            .collect();
        let stage = Stage::Grid(GridStage::Cells(boxes.form(), Rules::Without));
        let capacity = Capacity { found: Found::Words, entries: 1 };
        self.run(stage, parts, &sizes.params(capacity, u32::MAX), sizes.batches);
        let records: Vec<[i32; 4]> = read(&records, 2 * sizes.plane() as usize);
        let totals: Vec<GridTotals> = read(&totals, sizes.batches as usize);
        let (first, second) = records.split_at(sizes.plane() as usize);
        let keys = first.iter().zip(second).take(n as usize);
        let keys: Vec<KeyBox> = keys
            .map(|(a, b)| KeyBox { min: [a[0], a[1], a[2]], max: [a[3], b[0], b[1]] })
            .collect();
        for (i, home) in second.iter().enumerate().take(n as usize) {
            let position = i as u32 / UNPLACED_A_CELL;
            let is_nothing = keys[i] == KeyBox::NOTHING;
            let expected =
                if is_nothing { (first_nothing + position, NO_LEVEL) } else { (position, 0) };
            assert_eq!((home[2] as u32, home[3] as u32 >> 24), expected, "home of box {i}");
        }
        let seen = Seen {
            keys,
            invalid: bits(&read::<u32>(&invalid, sizes.plane() as usize / 32), n),
            empty: totals.iter().map(|batch| batch.empty).sum(),
        };
        let invalid: u32 = totals.iter().map(|batch| batch.invalid).sum();
        assert_eq!(invalid, seen.invalid.iter().map(|bit| u32::from(*bit)).sum::<u32>());
        seen
    }
}

fn read<T: Pod>(block: &Block, count: usize) -> Vec<T> {
    let mut values = vec![T::zeroed(); count];
    block.read(0, &mut values);
    values
}

fn bits(words: &[u32], n: u32) -> Vec<bool> {
    (0..n).map(|i| words[i as usize / 32] >> (i % 32) & 1 == 1).collect()
}

/// A form's smallest and largest coordinates, and coordinates that are hard to convert.
fn special(form: BoxForm) -> (u32, u32, Vec<u32>) {
    match form {
        BoxForm::F32 => {
            let signless = [0, 1, 0x007f_ffff, 0x0080_0000, 0x3f80_0000, 0x7f7f_ffff, 0x7f80_0000];
            let nan = [0x7f80_0001, 0x7fc0_0000, 0x7fff_ffff];
            let signless = signless.into_iter().chain(nan);
            let both = signless.flat_map(|bits| [bits, bits | 1 << 31]).collect();
            (f32::NEG_INFINITY.to_bits(), f32::INFINITY.to_bits(), both)
        }
        BoxForm::F16 => {
            let signless = [0, 1, 0x03ff, 0x0400, 0x3c00, 0x7bff, 0x7c00, 0x7c01, 0x7e00, 0x7fff];
            let both = signless.into_iter().flat_map(|bits| [bits, bits | 1 << 15]).collect();
            (0xfc00, 0x7c00, both)
        }
        BoxForm::Q16 => (0, 0xffff, vec![0, 1, 2, 0xff, 0x100, 0x7fff, 0x8000, 0xfffe, 0xffff]),
        BoxForm::Q8 => (0, 0xff, (0..=0xff).collect()),
    }
}

/// Boxes that have every number of a form of 16 bits or fewer at each place, all pairs of special
/// ones as min.x and max.x (which mark invalid boxes), and random ones.
fn patterns(form: BoxForm) -> Vec<[u32; 6]> {
    let (least, largest, special) = special(form);
    let all = [least, least, least, largest, largest, largest];
    let mut patterns = Vec::new();
    let everywhere: Vec<u32> = match form {
        BoxForm::F32 => special.clone(),
        BoxForm::F16 | BoxForm::Q16 => (0..=0xffff).collect(),
        BoxForm::Q8 => (0..=0xff).collect(),
    };
    for position in 0..6 {
        patterns.extend(everywhere.iter().map(|number| {
            let mut bits = all;
            bits[position] = *number;
            bits
        }));
    }
    for min in &special {
        patterns.extend(special.iter().map(|max| [*min, least, least, *max, largest, largest]));
    }
    let mut rng = Rng::new(17);
    for _ in 0..20_000 {
        let any = |rng: &mut Rng| special[rng.bits() as usize % special.len()];
        patterns.push(std::array::from_fn(|_| any(&mut rng)));
        patterns.push(std::array::from_fn(|_| rng.bits() as u32));
    }
    patterns
}

#[test]
fn every_pattern_becomes_the_keys_of_the_box_that_stands_for_it() {
    for checks in [Checks::Off, Checks::On] {
        let mut bench = Bench::new(checks);
        for form in BoxForm::ALL {
            let patterns = patterns(form);
            assert!(patterns.len() > 40_000 && !patterns.len().is_multiple_of(256), "{form}");
            // The last batch is whole, or not; the last word of q8 is, or not.
            for n in [1, 2, 3, 255, 256, 257, 1023, patterns.len()] {
                let memory = NarrowMemory::of_bits(form, &patterns[patterns.len() - n..]);
                let expected = Seen::expected(memory.boxes());
                let nothing = expected.keys.iter().filter(|keys| **keys == KeyBox::NOTHING).count();
                assert!(n < 40_000 || nothing > 10 && n - nothing > 1000 && expected.empty > 0);
                for seen in [bench.keys(memory.boxes()), bench.cells(memory.boxes())] {
                    let wrong = seen.first_difference(&expected);
                    let pattern = wrong.and_then(|i| patterns[patterns.len() - n..].get(i));
                    assert_eq!(wrong, None, "{form}, {n} boxes: {pattern:x?}");
                }
            }
        }
    }
}

/// Bounds that a scene lies in, and that cut through it.
fn precisions(boxes: &[Aabb]) -> Vec<Precision> {
    let around = Bounds::around(boxes);
    let small = Bounds::new([2.0; 3], [9.0; 3]).expect("bounds");
    let cells = [around, small].into_iter();
    let cells = cells.flat_map(|bounds| [Precision::Q16(bounds), Precision::Q8(bounds)]);
    cells.chain([Precision::F16]).collect()
}

/// Frames of an engine in every narrow form against the modes' definitions. Returns how many.
fn check_forms(
    engine: &mut dyn Engine,
    encodings: &[Encoding],
    scenes: &[&str],
    sizes: &[u32],
) -> usize {
    let mut frames = 0;
    let mut reply = HeapReply::new();
    for scene in scenes {
        for n in sizes {
            let boxes = stress_scenes::named(scene).boxes(*n, 5);
            for precision in precisions(&boxes) {
                let memory = NarrowMemory::write(&precision, &boxes);
                let truth = naive_modes::truth(&boxes, &precision);
                for encoding in encodings {
                    let input = CullInput::boxes(memory.boxes()).encoding(*encoding);
                    check_frame(engine, &input, &truth, &mut reply).unwrap_or_else(|what| {
                        panic!("{scene}, {n} boxes, {precision:?}, {encoding}: {what}")
                    });
                    frames += 1;
                }
            }
        }
    }
    frames
}

const LISTED: [Encoding; 2] = [Encoding::Sparse, Encoding::List];

/// Scenes with boxes of every class, touching faces, and few enough pairs for the oracle.
const FEW: [&str; 4] = ["uniform", "lattice", "empty mixed in", "nan in each slot"];

#[test]
fn both_engines_answer_every_form_as_it_is_defined_at_every_small_size() {
    let sizes = tier::small_sizes();
    let found =
        check_forms(&mut gpu::engine(EngineOptions::default()), &Encoding::ALL, &FEW, &sizes);
    assert_eq!(found, 4 * sizes.len() * 5 * 3);
    let found = check_forms(&mut gpu::grid(&EngineOptions::default()), &LISTED, &FEW, &sizes);
    assert_eq!(found, 4 * sizes.len() * 5 * 2);
}

#[test]
fn both_engines_answer_every_form_of_every_scene() {
    let scenes: Vec<&str> = stress_scenes::ALL.iter().map(StressScene::name).collect();
    let sizes = [2, 257, 345];
    check_forms(&mut gpu::engine(EngineOptions::default()), &Encoding::ALL, &scenes, &sizes);
    check_forms(&mut gpu::grid(&EngineOptions::default()), &LISTED, &scenes, &sizes);
}

#[test]
#[ignore = "slow: the nightly tier runs it"]
fn odd_large_scenes_checked_stages_and_every_way_up_answer_the_same() {
    let (large, small) = ([511, 513, 1233, 3801], [33, 345, 701]);
    check_forms(&mut gpu::engine(EngineOptions::default()), &Encoding::ALL, &FEW, &large);
    check_forms(&mut gpu::grid(&EngineOptions::default()), &LISTED, &FEW, &large);
    for upload in [Upload::KernelReads, Upload::DmaCopy, Upload::MappedVideo] {
        for checks in [Checks::Off, Checks::On] {
            let upload = Some(upload);
            let options = EngineOptions { checks, upload, ..EngineOptions::default() };
            check_forms(&mut gpu::engine(options), &Encoding::ALL, &FEW, &small);
            let options = EngineOptions { checks, upload, ..EngineOptions::default() };
            check_forms(&mut gpu::grid(&options), &LISTED, &FEW, &small);
        }
    }
}

/// Frames of one number of boxes and of different forms, in memory of one address: a recorded frame
/// is one form's.
#[test]
fn a_recorded_frame_is_of_one_form() {
    let boxes = stress_scenes::named("uniform").boxes(345, 8);
    let mut reply = HeapReply::new();
    let (mut all_pairs, mut grid) =
        (gpu::engine(EngineOptions::default()), gpu::grid(&EngineOptions::default()));
    for _ in 0..3 {
        for precision in precisions(&boxes).into_iter().chain([Precision::Exact]) {
            let memory = NarrowMemory::write(&precision, &boxes);
            let truth = naive_modes::truth(&boxes, &precision);
            let check = |report: Result<CullReport, CullError>, reply: &HeapReply| {
                let report = report.expect("a frame");
                let found = check_reply(reply.words(), &report, 345, Encoding::Sparse, &truth);
                assert_eq!(found, Ok(()), "{precision:?}");
            };
            check(all_pairs.cull(&CullInput::boxes(memory.boxes()), &mut reply), &reply);
            check(grid.cull(&CullInput::boxes(memory.boxes()), &mut reply), &reply);
        }
    }
}

/// Boxes of one form that are read as those of another of the same size.
#[test]
fn a_form_taken_for_another_is_noticed() {
    let boxes = stress_scenes::named("lattice").boxes(345, 2);
    let precision = Precision::Q16(Bounds::around(&boxes));
    let memory = NarrowMemory::write(&precision, &boxes);
    let halves = BoxSlice::new(BoxForm::F16, memory.boxes().as_bytes()).expect("as many bytes");
    let truth = naive_modes::truth(&boxes, &precision);
    let mut grid = gpu::grid(&EngineOptions::default());
    let (report, reply) = gpu::cull(&mut grid, halves, Encoding::Sparse);
    let found = check_reply(reply.words(), &report, 345, Encoding::Sparse, &truth);
    let is_about_pairs = matches!(found, Err(Mismatch::Missing(_) | Mismatch::Extra(_)));
    assert!(is_about_pairs || matches!(found, Err(Mismatch::Census { .. })), "{found:?}");
}
