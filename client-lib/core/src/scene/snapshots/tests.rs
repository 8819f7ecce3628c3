use std::collections::BTreeMap;

use super::super::{Edit, FilterDataSets, Indices, SceneCopy, Sets, Step, UserData, UserDataSets};
use super::*;
use crate::aabb::Aabb;
use crate::filters::{Filter, FilterData, FilterTable, Owner};

const LIMIT: u32 = 12;

struct Dice(u64);

impl Dice {
    fn below(&mut self, end: u32) -> u32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (self.0 >> 33) as u32 % end
    }
}

/// All of a scene, in words. A scene that had rules says that it has none.
fn seen(copy: &SceneCopy) -> Vec<String> {
    let mut lines = Vec::new();
    for step in copy.whole().steps() {
        let mut indices = Vec::new();
        step.indices().inspect(|named| named.for_each(|_, index| indices.push(index)));
        lines.push(match step {
            Step::Set(Sets { boxes, .. }) => format!("{indices:?} {boxes:?}"),
            Step::FilterData(FilterDataSets { filter_data, .. }) => {
                // Static flags have a step of their own.
                let data = filter_data.iter().map(|data| data.with_static(false));
                let given =
                    indices.iter().zip(data).filter(|(_, data)| *data != FilterData::default());
                format!("{:?}", given.collect::<Vec<_>>())
            }
            Step::UserData(UserDataSets { user_data, .. }) => format!("{indices:?} {user_data:?}"),
            Step::Filters(table) => format!("{:?}", table.filters()),
            Step::Include(pairs, _) | Step::Exclude(pairs, _) => format!("{pairs:?}"),
            _ => format!("{indices:?}"),
        });
    }
    lines.retain(|line| line != "[]" && line != "[] []");
    lines
}

fn replicas(copy: &SceneCopy) -> Replicas<'_> {
    Replicas { now: copy.into(), sent: None }
}

fn apply(copy: &mut SceneCopy, snapshots: &mut Snapshots, steps: &[Step<'_>]) {
    let edit = Edit { steps };
    snapshots.note(edit, &replicas(copy), LIMIT);
    copy.check(edit).expect("a right edit");
    copy.apply(edit);
    snapshots.note_applied(edit);
}

fn some_edit(dice: &mut Dice, copy: &mut SceneCopy, snapshots: &mut Snapshots) {
    let index = dice.below(LIMIT);
    let list = [index];
    let one = Indices::List(&list);
    let is_there = copy.get(index).is_some();
    let boxes = [Aabb::new([0.0; 3], [dice.below(3) as f32; 3])];
    let filter_data = [FilterData::default().with_owner(Owner(dice.below(3)))];
    let filters: Vec<Filter> = (0..dice.below(3)).map(|i| Filter::new(u64::from(i), 1)).collect();
    let table = FilterTable::new(&filters).expect("few filters");
    let pairs = [[index, (index + 1 + dice.below(LIMIT - 1)) % LIMIT]];
    let on = dice.below(2) == 0;
    let set = Step::Set(Sets { indices: one, boxes: &boxes });
    let user_data = [UserData::from(u64::from(dice.below(3)))];
    let steps: &[Step<'_>] = match dice.below(9) {
        0 if is_there => &[Step::Remove(one)],
        1 if is_there => &[Step::Remove(one), set],
        2 if is_there => &[Step::Enable(one, on)],
        3 if is_there => &[Step::Static(one, on)],
        4 if is_there => {
            &[Step::FilterData(FilterDataSets { indices: one, filter_data: &filter_data })]
        }
        7 if is_there => &[Step::UserData(UserDataSets { indices: one, user_data: &user_data })],
        5 => &[Step::Filters(&table)],
        6 if on => &[Step::Include(&pairs, dice.below(3) > 0)],
        6 => &[Step::Exclude(&pairs, dice.below(3) > 0)],
        _ => &[set],
    };
    apply(copy, snapshots, steps);
}

#[test]
fn any_snapshot_is_reached_from_any_other() {
    for seed in 0..300 {
        let mut dice = Dice(seed);
        let (mut copy, mut snapshots) = (SceneCopy::new(LIMIT), Snapshots::default());
        let mut taken: BTreeMap<SnapshotId, SceneCopy> = BTreeMap::new();
        for _ in 0..200 {
            let drawn = taken.keys().nth(dice.below(6) as usize).copied();
            match (dice.below(8), drawn) {
                (0, _) => drop(taken.insert(snapshots.take(), copy.clone())),
                (1, Some(id)) => {
                    snapshots.forget(id).expect("a snapshot");
                    taken.remove(&id);
                }
                (2, Some(id)) => {
                    snapshots.begin_restore(id, &replicas(&copy)).expect("a snapshot");
                    let mut last = None;
                    while let Some(phase) = snapshots.next_phase(&replicas(&copy), last.as_ref()) {
                        snapshots.note_phase(&phase, &replicas(&copy));
                        let steps = phase.steps();
                        copy.check(Edit { steps: &steps }).expect("a right edit");
                        copy.apply(Edit { steps: &steps });
                        snapshots.note_applied(Edit { steps: &steps });
                        snapshots.end_phase(&phase);
                        last = Some(phase);
                    }
                    assert_eq!(seen(&copy), seen(&taken[&id]), "seed {seed}");
                }
                (3, _) => snapshots.acknowledge(7),
                (4, _) if dice.below(9) == 0 => snapshots.resync(),
                _ => some_edit(&mut dice, &mut copy, &mut snapshots),
            }
            assert_eq!(snapshots.is_empty(), taken.is_empty());
            assert!(snapshots.nodes.len() < 2 * taken.len().max(1), "needless nodes stay");
        }
    }
}

#[test]
fn what_was_forgotten_is_an_error_and_leaves_nothing() {
    let (mut copy, mut snapshots) = (SceneCopy::new(LIMIT), Snapshots::default());
    let mut dice = Dice(1);
    let ids: Vec<SnapshotId> = (0..9)
        .map(|_| {
            some_edit(&mut dice, &mut copy, &mut snapshots);
            snapshots.take()
        })
        .collect();
    for &id in &ids {
        snapshots.forget(id).expect("a snapshot");
        assert_eq!(snapshots.forget(id), Err(UnknownSnapshot { id }));
        assert_eq!(snapshots.begin_restore(id, &replicas(&copy)), Err(UnknownSnapshot { id }));
    }
    some_edit(&mut dice, &mut copy, &mut snapshots);
    assert!(snapshots.is_empty() && snapshots.log.delta().is_empty());
    assert_eq!(snapshots.allocated_bytes(), 0);
}
