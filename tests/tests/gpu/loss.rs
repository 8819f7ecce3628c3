//! A device that is lost under load: no wrong answer, a typed error, and recovery.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use pairmask_tests::gpu::open;
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::{Gpu, GpuSlot, HostImport, IfMissing, OpenError, Opener, SlotState};

/// A watchdog, no measure of speed: opening a software device takes under a second.
const GIVE_UP: Duration = Duration::from_secs(60);

#[test]
fn a_device_that_cannot_be_opened_again_leaves_the_slot_lost() {
    let gpu = open(HostImport::IfPossible);
    let first = Mutex::new(Some(Arc::clone(&gpu)));
    let once = move || first.lock().expect("no panic").take().ok_or(OpenError::SwitchedOff);
    let mut slot = GpuSlot::opening(Arc::new(once), IfMissing::DoWithout);
    eventually("the first device", || slot.ready().map(drop));
    assert_eq!(slot.state(), SlotState::Ready);
    gpu.destroy();
    let deadline = Instant::now() + GIVE_UP;
    let mut seen_lost = false;
    while !seen_lost {
        assert!(slot.ready().is_none());
        seen_lost = matches!(slot.state(), SlotState::Lost);
        assert!(Instant::now() < deadline);
        std::thread::yield_now();
    }
}

/// What a slot says whose first device was opened by `open`, as soon as that has ended.
fn opened(open: Opener<Arc<Gpu>>, if_missing: IfMissing) -> SlotState {
    let mut slot = GpuSlot::opening(open, if_missing);
    assert_eq!(slot.state(), SlotState::Opening);
    let deadline = Instant::now() + GIVE_UP;
    while slot.state() == SlotState::Opening {
        assert_eq!(slot.ready().is_some(), slot.state() == SlotState::Ready);
        assert!(Instant::now() < deadline);
        std::thread::yield_now();
    }
    slot.state()
}

#[test]
fn a_slot_does_without_its_first_device_or_reports_why_or_goes_on_trying() {
    let none = || -> Opener<Arc<Gpu>> { Arc::new(|| Err(OpenError::SwitchedOff)) };
    let there: Opener<Arc<Gpu>> = Arc::new(|| Ok(open(HostImport::IfPossible)));
    assert_eq!(opened(there, IfMissing::DoWithout), SlotState::Ready);
    assert_eq!(opened(none(), IfMissing::DoWithout), SlotState::Missing);
    assert!(matches!(opened(none(), IfMissing::TryAgain), SlotState::Lost));
    let reported = Arc::new(AtomicUsize::new(0));
    let counts = Arc::clone(&reported);
    let report = IfMissing::Report(Arc::new(move |error| {
        assert!(matches!(error, OpenError::SwitchedOff), "{error}");
        counts.fetch_add(1, Ordering::Relaxed);
    }));
    assert_eq!(opened(none(), report), SlotState::Missing);
    assert_eq!(reported.load(Ordering::Relaxed), 1);
    // A driver that panics has no device.
    let panics: Opener<Arc<Gpu>> = Arc::new(|| panic!("meant"));
    assert_eq!(opened(panics, IfMissing::DoWithout), SlotState::Missing);
}
