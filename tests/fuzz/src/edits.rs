//! Edits of a scene as they lie in a payload: one after the other, beside the naive model.

use pairmask_core::engine::EngineChoice;
use pairmask_core::scene::{
    Edit, FilterDataSets, Report, Scene, SceneOptions, Sets, Step, UserDataSets,
};
use pairmask_tests::scene_model::{Listener, Model, Op};
use pairmask_wire::{EditScratch, PAGE_BYTES, Page, SceneId, SceneRequest, Section, SectionKind};

use crate::input::{Input, pages_of};

/// Indices of a scene at most.
const MOST_BOXES: u32 = 80;
/// Edits of an input at most.
const MOST_EDITS: usize = 16;
/// Boxes, steps and words of an edit are fewer.
const PARTS: [u32; 3] = [24, 12, 64];
/// Bytes of a box and a step.
const ENTRY_BYTES: [usize; 3] = [24, 24, 4];

pub fn decode(data: &[u8]) {
    let mut input = Input(data);
    let most_boxes = input.below(MOST_BOXES);
    let mut scene = Scene::new(SceneOptions::default().with_most_boxes(most_boxes));
    let (mut model, mut listener) = (Model::default(), Listener::new(0, false, None));
    let mut scratch = EditScratch::default();
    for _ in 0..MOST_EDITS {
        if input.is_empty() {
            break;
        }
        let (request, pages) = edit(&mut input, most_boxes);
        let Ok(steps) = scratch.read(&request, &pages) else { continue };
        let edit = Edit { steps: &steps };
        if request.is_lost {
            scene.resync();
            listener.is_lost = true;
        }
        if scene.edit(edit, request.report).is_err() {
            continue;
        }
        let named = model.apply(0, &ops(&steps));
        listener.note_named(&named, false);
        listener.note_edit();
        let now = model.pairs();
        let expected = listener.expects(&model, &now, request.report);
        let reported = pairmask_tests::received!(scene.reported());
        assert_eq!(reported, expected, "{:?}", request.report);
        assert_eq!(scene.len(), model.len());
        if let Some(pair_count) = request.reported {
            // A client that says so knows how many there are. One that lies is its own victim: nothing panics.
            scene.mark_reported(pair_count);
            if pair_count != now.len() as u64 {
                return lie(&mut input, most_boxes, &mut scene);
            }
            listener.acknowledge(&now, Report::All);
        } else if request.is_acknowledged {
            scene.acknowledge();
            listener.acknowledge(&now, request.report);
        }
    }
}

/// Goes on with a scene whose client has reported a wrong number of pairs.
fn lie(input: &mut Input<'_>, most_boxes: u32, scene: &mut Scene) {
    let mut scratch = EditScratch::default();
    for _ in 0..MOST_EDITS {
        let (request, pages) = edit(input, most_boxes);
        let Ok(steps) = scratch.read(&request, &pages) else { continue };
        let _ = scene.edit(Edit { steps: &steps }, request.report);
        if request.is_acknowledged {
            scene.acknowledge();
        }
    }
}

/// The next edit, and its payload.
fn edit(input: &mut Input<'_>, most_boxes: u32) -> (SceneRequest, Vec<Page>) {
    let flags = input.byte();
    let counts = PARTS.map(|end| input.below(end));
    let mut payload = Vec::new();
    let mut starts = [0; 3];
    starts[0] = payload.len();
    for b in input.some(counts[0], Input::aabb) {
        payload.extend_from_slice(bytemuck::bytes_of(&b));
    }
    starts[1] = payload.len();
    // What it does, how it names indices, the first one, how many, where its words and its entries begin.
    let step = |input: &mut Input<'_>| {
        let [does, names] = [input.below(15), input.below(5)];
        let [first, count, words_at, entries_at] = [0; 4].map(|_: u8| input.number());
        [does, names, first, count, words_at, entries_at]
    };
    for step in input.some(counts[1], step) {
        payload.extend_from_slice(bytemuck::cast_slice(&step));
    }
    starts[2] = payload.len();
    for word in input.some(counts[2], Input::number) {
        payload.extend_from_slice(&word.to_le_bytes());
    }
    let ends = [starts[1], starts[2], payload.len()];
    let kinds = [SectionKind::Boxes, SectionKind::SceneSteps, SectionKind::SceneIndices];
    let section = |at: usize| {
        let bytes = (ends[at] - starts[at]) / ENTRY_BYTES[at] * ENTRY_BYTES[at];
        Section::required(kinds[at], starts[at] as u64, bytes as u64)
    };
    let request = SceneRequest {
        scene: SceneId(1),
        base: 1,
        revision: 2,
        is_acknowledged: flags & 4 != 0,
        is_lost: flags & 0x78 == 8,
        reported: (flags & 0xf0 == 0x10).then(|| input.long() >> 1),
        report: [Report::Changes, Report::Moved, Report::All, Report::Nothing]
            [usize::from(flags & 3)],
        most_boxes,
        engine: EngineChoice::Auto,
        threads: None,
        boxes: section(0),
        steps: section(1),
        indices: section(2),
    };
    assert!(payload.len() <= 2 * PAGE_BYTES);
    (request, pages_of(&payload))
}

/// What steps do, as the model takes it.
fn ops(steps: &[Step<'_>]) -> Vec<Op> {
    let mut ops = Vec::new();
    for step in steps {
        match *step {
            Step::Remove(indices) => indices.for_each(|_, index| ops.push(Op::Remove(index))),
            Step::Set(Sets { indices, boxes }) => {
                indices.for_each(|at, index| ops.push(Op::Set(index, boxes[at])));
            }
            Step::Enable(indices, on) => {
                indices.for_each(|_, index| ops.push(Op::Enable(index, on)));
            }
            Step::Static(indices, on) => {
                indices.for_each(|_, index| ops.push(Op::Static(index, on)));
            }
            Step::FilterData(FilterDataSets { indices, filter_data }) => {
                indices.for_each(|at, index| ops.push(Op::FilterData(index, filter_data[at])));
            }
            Step::UserData(UserDataSets { indices, user_data }) => {
                indices.for_each(|at, index| ops.push(Op::UserData(index, user_data[at].into())));
            }
            Step::Filters(table) => ops.push(Op::Filters(table.filters().to_vec())),
            Step::Include(pairs, on) => {
                ops.extend(pairs.iter().map(|pair| Op::Include(*pair, on)));
            }
            Step::Exclude(pairs, on) => {
                ops.extend(pairs.iter().map(|pair| Op::Exclude(*pair, on)));
            }
            _ => panic!("a step that the model does not know"),
        }
    }
    ops
}
