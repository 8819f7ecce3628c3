//! A frame of a case, written, sent and read as a client does it.

use pairmask::{FrameError, PendingFrame, ServedBy, Session, WaitError};

use crate::stress::modes::Sending;
use crate::stress::{Answer, Case, Form};

/// Writes and sends a frame, on a thread with the floating-point flags of the case's caller.
pub(super) fn send(
    session: &mut Session,
    case: &Case,
    form: Form,
) -> Result<PendingFrame, FrameError> {
    // Its truth is computed with the default flags, if it is not there yet.
    case.allowed(form);
    case.flags.caller.run(|| match form {
        Form::Spheres => {
            let spheres = &case.spheres().spheres;
            let mut frame = session.sphere_frame(spheres.len())?;
            frame.spheres_mut().copy_from_slice(spheres);
            frame.submit()
        }
        Form::Mode(usage) if let Sending::Narrow(precision) = &case.in_mode(usage).sending => {
            let given = &case.in_mode(usage).given;
            let mut frame = session.narrow_frame(given.len(), *precision)?;
            frame.fill(&given[..]);
            frame.submit()
        }
        _ => {
            let boxes = match form {
                Form::Mode(usage) => &case.in_mode(usage).sent,
                _ => &case.boxes,
            };
            let mut frame = session.frame(boxes.len())?;
            frame.write(&boxes[..]);
            frame.submit()
        }
    })
}

/// Awaits a frame and decodes it, on a thread with the floating-point flags of the case's caller.
pub(super) fn receive(pending: PendingFrame, case: &Case) -> Result<(Answer, ServedBy), WaitError> {
    let (mut answer, by) = case.flags.caller.run(|| {
        let mask = pending.wait()?;
        let (pairs, count, info) = (mask.to_vec(), mask.count(), mask.info());
        Ok::<_, WaitError>((Answer { pairs, count, census: info.census }, info.served_by))
    })?;
    answer.pairs.sort_unstable();
    Ok((answer, by))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use pairmask::Backend;

    use super::*;
    use crate::stress::modes::Usage;

    #[test]
    fn answers_of_a_session_are_right_in_every_form() {
        let mut session = Session::builder().backend(Backend::InProcess).connect().unwrap();
        let mut pairs = 0;
        for case in (1..20).map(Case::new) {
            for form in [Form::Boxes, Form::Spheres].into_iter().chain(Usage::ALL.map(Form::Mode)) {
                let pending = send(&mut session, &case, form).unwrap();
                let (answer, by) = receive(pending, &case).unwrap();
                assert_eq!(case.check(form, &answer), Ok(()), "{form}");
                assert_eq!(by, ServedBy::InProcess);
                pairs += answer.pairs.len();
            }
        }
        assert!(pairs > 1_000, "{pairs}");
    }
}
