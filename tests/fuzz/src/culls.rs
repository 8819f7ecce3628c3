//! Frames with rules, by every engine and in every encoding, beside the oracle and the naive model.

use pairmask_core::dispatch::{CpuEngines, CullOptions, SphereEngines};
use pairmask_core::engine::HeapReply;
use pairmask_core::filters::{FilterTable, Rules};
use pairmask_core::mask::{Encoding, MaskView};
use pairmask_core::objects::{ObjectForm, Objects};
use pairmask_core::oracle;
use pairmask_core::precision::ExpandScratch;
use pairmask_core::units::BoxCount;
use pairmask_core::{Aabb, EncodingChoice, EngineChoice, EngineName};
use pairmask_tests::scene_model::{Model, Op};

use crate::input::Input;

/// Boxes and filters of a frame, and pairs of its lists, are fewer.
const MOST_BOXES: u32 = 120;
const MOST_FILTERS: u32 = 6;
const MOST_LISTED: u32 = 10;
/// Bytes of a reply: some frames have no room for their mask.
const FEW_BYTES: u64 = 256;
const MANY_BYTES: u64 = 1 << 20;

pub fn decode(data: &[u8]) {
    let mut input = Input(data);
    let kind = input.byte();
    let form = ObjectForm::ALL[usize::from(kind & 7) % ObjectForm::ALL.len()];
    let limit_bytes = if kind & 0x18 == 0x18 { FEW_BYTES } else { MANY_BYTES };
    let options = CullOptions {
        engine: some_engine(input.byte()),
        encoding: some_encoding(input.byte()),
        threads: Some(1),
        ..CullOptions::default()
    };
    if kind & 0x20 == 0 {
        let boxes = input.some(MOST_BOXES, Input::aabb);
        let rules = rules(&mut input, boxes.len() as u32);
        cull(&boxes, &rules, &options, limit_bytes);
        let first = BoxCount::new(input.below(MOST_BOXES).min(boxes.len() as u32));
        cull_sets(&boxes, first, &options, limit_bytes);
        return;
    }
    // The bytes of objects as another process has written them: aligned, and as many as are whole.
    let len = input.0.len() / form.object_bytes() * form.object_bytes();
    let mut words = vec![0u32; len.div_ceil(4)];
    bytemuck::cast_slice_mut(&mut words)[..len].copy_from_slice(&input.0[..len]);
    match Objects::new(form, &bytemuck::cast_slice(&words)[..len]).expect("whole and aligned") {
        Objects::Boxes(boxes) => {
            let some = boxes.len().min(MOST_BOXES as usize);
            let each: Vec<Aabb> = (0..some).filter_map(|at| boxes.get(at)).collect();
            let mut scratch = ExpandScratch::default();
            let expanded = boxes.expand(&mut scratch, false);
            let all = expanded.as_f32().expect("they were expanded");
            // A NaN is not equal to itself.
            assert_eq!(format!("{:?}", &all[..some]), format!("{each:?}"));
            cull(&each, &Rules::default(), &options, limit_bytes);
        }
        Objects::Spheres(spheres) => {
            let spheres = &spheres[..spheres.len().min(MOST_BOXES as usize)];
            let mut reply = HeapReply::with_limit_bytes(limit_bytes);
            let culled = SphereEngines::new().cull(spheres, &options, &mut reply);
            let Ok(answer) = culled else { return };
            let n = BoxCount::new(spheres.len() as u32);
            let mask = MaskView::new(n, &answer.report.shape, reply.words()).expect("a mask");
            mask.verify().expect("a right mask");
            let mut pairs = mask.to_vec();
            pairs.sort_unstable();
            assert_eq!(pairs, pairmask_tests::spheres::truth(spheres).pairs);
        }
    }
}

fn some_engine(byte: u8) -> EngineChoice {
    match EngineName::ALL.get(usize::from(byte) % (EngineName::ALL.len() + 1)) {
        Some(engine) => EngineChoice::Only(*engine),
        None => EngineChoice::Auto,
    }
}

fn some_encoding(byte: u8) -> EncodingChoice {
    match Encoding::ALL.get(usize::from(byte) % (Encoding::ALL.len() + 1)) {
        Some(encoding) => EncodingChoice::Only(*encoding),
        None => EncodingChoice::Auto,
    }
}

/// Rules of so many boxes.
fn rules(input: &mut Input<'_>, n: u32) -> Rules {
    let mut rules = Rules::default();
    if n == 0 {
        return rules;
    }
    let counts = [n + 1, MOST_FILTERS, MOST_LISTED].map(|end| input.below(end));
    rules.filter_data = input.some(counts[0], Input::filter_data);
    rules.table = FilterTable::new(&input.some(counts[1], Input::filter)).expect("few filters");
    for [list, a, b] in input.some(counts[2], |input| [0; 3].map(|_: u8| input.below(n))) {
        if list % 2 == 0 {
            rules.lists.include([a, b], true);
        } else {
            rules.lists.exclude([a, b], true);
        }
    }
    rules
}

fn cull(boxes: &[Aabb], rules: &Rules, options: &CullOptions, limit_bytes: u64) {
    let mut reply = HeapReply::with_limit_bytes(limit_bytes);
    let mut engines = CpuEngines::new();
    let Ok(answer) = engines.cull_filtered(boxes, rules, options, &mut reply) else { return };
    let (report, worlds) = (answer.answer.report, answer.worlds.to_vec());
    let n = BoxCount::new(boxes.len() as u32);
    let mask = MaskView::new(n, &report.shape, reply.words()).expect("a mask");
    let mut pairs = mask.to_vec();
    let in_worlds: usize = worlds.iter().map(|world| world.pairs.len()).sum();
    assert!(worlds.is_empty() || in_worlds == pairs.len());
    pairs.sort_unstable();
    assert_eq!(pairs.len() as u64, report.pair_count);
    assert_eq!(pairs, naive_pairs(boxes, rules), "{:?}", answer.answer.engine);
    mask.verify().expect("a right mask");
}

/// Pairs by the model, in which a step says what is static, and not the filter data.
fn naive_pairs(boxes: &[Aabb], rules: &Rules) -> Vec<[u32; 2]> {
    let mut ops = vec![Op::Filters(rules.table.filters().to_vec())];
    ops.extend((0..).zip(boxes).map(|(index, b)| Op::Set(index, *b)));
    for (index, filter_data) in (0..).zip(&rules.filter_data) {
        ops.push(Op::FilterData(index, *filter_data));
        ops.push(Op::Static(index, filter_data.is_static()));
    }
    ops.extend(rules.lists.included().map(|pair| Op::Include(pair, true)));
    ops.extend(rules.lists.excluded().map(|pair| Op::Exclude(pair, true)));
    let mut model = Model::default();
    model.apply(0, &ops);
    model.pairs().into_keys().collect()
}

fn cull_sets(boxes: &[Aabb], first: BoxCount, options: &CullOptions, limit_bytes: u64) {
    let mut reply = HeapReply::with_limit_bytes(limit_bytes);
    let culled = CpuEngines::new().cull_sets(boxes, first, options, &mut reply);
    let Ok(answer) = culled else { return };
    let n = BoxCount::new(boxes.len() as u32);
    let mask = MaskView::new(n, &answer.report.shape, reply.words()).expect("a mask");
    let mut pairs = mask.to_vec();
    pairs.sort_unstable();
    let mut expected = oracle::truth(boxes).pairs;
    expected.retain(|[a, b]| *a < first.get() && first.get() <= *b);
    assert_eq!(pairs, expected, "two sets, {:?}", answer.engine);
}
