//! A frame of a case: written and sent as a client does it, and its answer compared with the oracle.

use pairmask::info::Census;
use pairmask::{FrameError, PendingFrame, ServedBy, Session, WaitError};
use pairmask_core::oracle::Pair;
use serde::{Deserialize, Serialize};

use super::offer::Form;
use crate::stress::case::Case;
use crate::stress::gaps;
use crate::stress::modes::Sending;
use crate::stress::subject::{Finding, compare};

/// Which case a frame is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct CaseId {
    /// The case's seed.
    pub(super) seed: u64,
    /// Whether it is the large one of that seed.
    pub(super) is_large: bool,
}

impl CaseId {
    /// The case.
    pub(super) fn case(self) -> Case {
        if self.is_large { Case::large(self.seed) } else { Case::new(self.seed) }
    }
}

/// Writes and sends a frame, on a thread with the floating-point flags of the case's caller.
pub(super) fn send(
    session: &mut Session,
    case: &Case,
    form: Form,
) -> Result<PendingFrame, FrameError> {
    // Made with the default flags, if it is not there yet.
    match form {
        Form::Boxes => {}
        Form::Spheres => drop(case.spheres()),
        Form::Mode(usage) => drop(case.in_mode(usage)),
    }
    case.flags.caller.run(|| write_and_submit(session, case, form))
}

fn write_and_submit(
    session: &mut Session,
    case: &Case,
    form: Form,
) -> Result<PendingFrame, FrameError> {
    match form {
        Form::Boxes => {
            let mut frame = session.frame(case.boxes.len())?;
            frame.write(&case.boxes[..]);
            frame.submit()
        }
        Form::Spheres => {
            let spheres = &case.spheres().spheres;
            let mut frame = session.sphere_frame(spheres.len())?;
            frame.spheres_mut().copy_from_slice(spheres);
            frame.submit()
        }
        Form::Mode(usage) => {
            let case = case.in_mode(usage);
            match &case.sending {
                Sending::Narrow(precision) => {
                    let mut frame = session.narrow_frame(case.given.len(), *precision)?;
                    frame.fill(&case.given[..]);
                    frame.submit()
                }
                Sending::Inflated(_) | Sending::World { .. } => {
                    let mut frame = session.frame(case.sent.len())?;
                    frame.write(&case.sent[..]);
                    frame.submit()
                }
            }
        }
    }
}

/// What came back for a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Answer {
    /// What answered.
    pub(super) served_by: ServedBy,
    /// The pairs as the library decodes them, sorted.
    pairs: Vec<Pair>,
    /// Pairs as the engine counted them.
    count: u64,
    census: Census,
}

/// Awaits a frame and decodes it, on a thread with the floating-point flags of the case's caller.
///
/// # Errors
/// [`WaitError`].
pub(super) fn receive(pending: PendingFrame, case: &Case) -> Result<Answer, WaitError> {
    let mut answer = case.flags.caller.run(|| {
        let mask = pending.wait()?;
        let info = mask.info();
        Ok::<_, WaitError>(Answer {
            served_by: info.served_by,
            pairs: mask.to_vec(),
            count: mask.count(),
            census: info.census,
        })
    })?;
    answer.pairs.sort_unstable();
    Ok(answer)
}

/// Compares an answer with the oracle.
///
/// # Errors
/// [`Finding`] with the mistake.
pub(super) fn check(answer: &Answer, case: &Case, form: Form) -> Result<(), Finding> {
    let Answer { pairs, count, census, .. } = answer;
    check_pairs(pairs, case, form)?;
    if *count != pairs.len() as u64 {
        let decoded = pairs.len();
        let what = format!("the answer counts {count} pairs, the mask has {decoded}");
        return Err(Finding::other(&what));
    }
    let expected = match form {
        Form::Boxes => case.truth.census,
        Form::Mode(usage) => case.in_mode(usage).allowed.must.census,
        Form::Spheres => return Ok(()),
    };
    if *census != expected {
        return Err(Finding::other(&format!("census {census:?}, expected {expected:?}")));
    }
    Ok(())
}

/// Compares sorted pairs with those of the oracle.
fn check_pairs(got: &[Pair], case: &Case, form: Form) -> Result<(), Finding> {
    if let Some(twice) = got.windows(2).find(|two| two[0] == two[1]) {
        let what = format!("pair {:?} is in the answer twice", twice[0]);
        return Err(Finding { what, missed: 0, extra: 1, first: Some(twice[0]) });
    }
    match form {
        Form::Boxes => compare(got, &case.truth.pairs, &case.truth.pairs),
        Form::Spheres => {
            let pairs = &case.spheres().pairs;
            compare(got, pairs, pairs)
        }
        Form::Mode(usage) => {
            let case = case.in_mode(usage);
            compare(got, &case.allowed.must.pairs, &case.allowed.may)?;
            gaps::check(case, got)
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use pairmask::Backend;

    use super::*;
    use crate::stress::modes::Usage;

    /// A case with pairs in every form.
    fn case() -> Case {
        let has_pairs = |case: &Case| {
            let modes = || Usage::ALL.iter().map(|usage| &case.in_mode(*usage).allowed.must);
            case.truth.pairs.len() > 5
                && case.spheres().pairs.len() > 5
                && modes().all(|truth| truth.pairs.len() > 5)
        };
        (1..1_000).map(Case::new).find(has_pairs).unwrap()
    }

    fn forms() -> impl Iterator<Item = Form> {
        [Form::Boxes, Form::Spheres].into_iter().chain(Usage::ALL.map(Form::Mode))
    }

    #[test]
    fn answers_of_a_session_are_right_in_every_form_and_altered_ones_are_noticed() {
        let case = case();
        let mut session = Session::builder().backend(Backend::InProcess).connect().unwrap();
        for form in forms() {
            let pending = send(&mut session, &case, form).unwrap();
            let right = receive(pending, &case).unwrap();
            assert_eq!(check(&right, &case, form), Ok(()), "{form}");
            assert_eq!(right.served_by, ServedBy::InProcess);

            let of =
                |pairs: Vec<Pair>| Answer { count: pairs.len() as u64, pairs, ..right.clone() };
            let must = match form {
                Form::Boxes => case.truth.pairs.clone(),
                Form::Spheres => case.spheres().pairs.clone(),
                Form::Mode(usage) => case.in_mode(usage).allowed.must.pairs.clone(),
            };
            assert_eq!(check(&of(must.clone()), &case, form), Ok(()), "{form}");
            let missed = check(&of(must[1..].to_vec()), &case, form).unwrap_err();
            assert_eq!((missed.missed, missed.extra, missed.first), (1, 0, Some(must[0])));
            let doubled = [&must[..1], &must[..]].concat();
            assert!(check(&of(doubled), &case, form).unwrap_err().what.contains("twice"));
            let added = [&must[..], &[(u32::MAX - 1, u32::MAX)]].concat();
            let extra = check(&of(added), &case, form).unwrap_err();
            assert_eq!((extra.missed, extra.extra), (0, 1), "{form}");
            let miscounted = Answer { count: right.count + 1, ..right.clone() };
            assert!(check(&miscounted, &case, form).unwrap_err().what.contains("counts"));
            let mut census = right.census;
            census.empty += 1;
            let is_noticed = check(&Answer { census, ..right.clone() }, &case, form).is_err();
            assert_eq!(is_noticed, form != Form::Spheres);
        }
    }
}
