//! Whether an edit fits the boxes that there are, before anything of it is applied.

use super::edit::{Edit, Indices};
use super::error::EditError;

/// Flag of an index: it has a box.
pub(super) const PRESENT: u8 = 1;
/// The edit under way removes its box.
pub(super) const EDIT_REMOVES: u8 = 1 << 4;
/// The edit under way sets its box.
pub(super) const EDIT_SETS: u8 = 1 << 5;

/// Indices that a scene with `len` of them has after an edit: every one that is set, and those before.
///
/// # Errors
/// [`EditError`] for what is wrong whatever boxes there are.
pub(super) fn len_after(edit: Edit<'_>, len: usize, limit: u32) -> Result<usize, EditError> {
    if let Some((indices, boxes)) = edit.uneven() {
        return Err(EditError::Lengths { indices, boxes });
    }
    let last_set = edit.last_set();
    let last = last_set.max(edit.last_named());
    let listed = edit.last_listed().map(u64::from);
    if let Some(index) = listed.filter(|index| *index >= u64::from(limit)) {
        return Err(EditError::BeyondLimit { index, limit });
    }
    if let Some(index) = last.filter(|index| *index >= u64::from(limit)) {
        return Err(EditError::BeyondLimit { index, limit });
    }
    let len = last_set.map_or(0, |last| last as usize + 1).max(len);
    match last.filter(|index| *index >= len as u64) {
        Some(index) => Err(EditError::Absent { index }),
        None => Ok(len),
    }
}

/// Marks what an edit removes and sets, and finds what is wrong. There are flags for as many indices
/// as [`len_after`] says.
///
/// # Errors
/// [`EditError`]; nothing is marked then.
pub(super) fn mark(edit: Edit<'_>, flags: &mut [u8]) -> Result<(), EditError> {
    let mut wrong = None;
    edit.for_each_removed(|index| {
        let flags = &mut flags[index as usize];
        if *flags & PRESENT == 0 || *flags & EDIT_REMOVES != 0 {
            wrong = wrong.or(Some(EditError::Absent { index: u64::from(index) }));
        }
        *flags |= EDIT_REMOVES;
    });
    for sets in edit.sets() {
        if let Indices::Range { first, count } = sets.indices {
            if count == 0 {
                // Its first index may be anything.
                continue;
            }
            // Without a branch an index: a scene that moves as a whole is such a range.
            let flags = &mut flags[first as usize..first as usize + count as usize];
            if flags.iter().fold(0, |all, flags| all | flags) & EDIT_SETS != 0 {
                let twice = flags.iter().position(|flags| flags & EDIT_SETS != 0).unwrap_or(0);
                wrong = wrong.or(Some(EditError::SetTwice { index: first + twice as u32 }));
            }
            for flags in flags {
                *flags |= EDIT_SETS;
            }
            continue;
        }
        sets.indices.for_each(|_, index| {
            let flags = &mut flags[index as usize];
            if *flags & EDIT_SETS != 0 {
                wrong = wrong.or(Some(EditError::SetTwice { index }));
            }
            *flags |= EDIT_SETS;
        });
    }
    let mut check = |index: u32| {
        let flags = flags[index as usize];
        let stays = flags & (PRESENT | EDIT_REMOVES) == PRESENT;
        if !stays && flags & EDIT_SETS == 0 {
            wrong = wrong.or(Some(EditError::Absent { index: u64::from(index) }));
        }
    };
    edit.for_each_flag(|index, _| check(index));
    edit.for_each_tag(|index, _| check(index));
    let Some(wrong) = wrong else { return Ok(()) };
    unmark(edit, flags);
    Err(wrong)
}

/// Takes the marks of an edit away. Every index that may have one is among its own.
pub(super) fn unmark(edit: Edit<'_>, flags: &mut [u8]) {
    edit.for_each_removed(|index| flags[index as usize] &= !(EDIT_REMOVES | EDIT_SETS));
    for sets in edit.sets() {
        match sets.indices {
            // Its first index may be anything.
            Indices::Range { count: 0, .. } => {}
            // Without a look at each index, as it was marked.
            Indices::Range { first, count } => {
                for flags in &mut flags[first as usize..first as usize + count as usize] {
                    *flags &= !(EDIT_REMOVES | EDIT_SETS);
                }
            }
            indices => {
                indices.for_each(|_, index| flags[index as usize] &= !(EDIT_REMOVES | EDIT_SETS));
            }
        }
    }
}
