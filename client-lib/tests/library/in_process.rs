//! Sessions in process, in every build: with a transport and without.

use std::sync::Arc;
use std::time::Duration;

use pairmask::filters::{FilterData, Owner, Rules, World};
use pairmask::{
    Aabb, Backend, Bounds, ConnectError, Error, FrameOptions, Precision, ServedBy, Session,
    SessionBuilder, Sphere,
};
use pairmask_core::engine::{AvailableIsa, Isa};
use pairmask_core::mask::{Encoding, EncodingChoice};
use pairmask_core::oracle;
use pairmask_core::precision::BoxForm;

/// Boxes a scene, on both sides of the sizes at which engines change.
const SIZES: [usize; 4] = [0, 3, 345, 1234];

/// A row of boxes of which each overlaps a few of the next ones; every tenth is disabled.
fn scene(n: usize) -> Vec<Aabb> {
    let at = |i: usize| [0.3 * i as f32, (i % 7) as f32 * 0.1, (i % 3) as f32 * 0.2];
    (0..n)
        .map(|i| if i % 10 == 9 { Aabb::EMPTY } else { Aabb::from_center_half(at(i), [0.5; 3]) })
        .collect()
}

fn sorted(mut pairs: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
    pairs.sort_unstable();
    pairs
}

fn pairs_of(session: &mut Session, boxes: &[Aabb]) -> Vec<[u32; 2]> {
    let mut frame = session.frame(boxes.len()).unwrap();
    assert!(!frame.is_shared());
    frame.boxes_mut().copy_from_slice(boxes);
    let mask = frame.submit().unwrap().wait().unwrap();
    assert_eq!(mask.info().served_by, ServedBy::InProcess);
    sorted(mask.to_vec())
}

fn in_process() -> SessionBuilder {
    Session::builder().backend(Backend::InProcess)
}

#[test]
fn frames_have_the_pairs_of_the_oracle() {
    let mut session = in_process().connect().unwrap();
    for n in SIZES {
        let boxes = scene(n);
        assert_eq!(pairs_of(&mut session, &boxes), oracle::truth(&boxes).pairs, "{n} boxes");
    }
    assert_eq!(session.served_by(), ServedBy::InProcess);
}

#[test]
fn a_wait_without_end_gets_the_pairs() {
    let mut session = in_process().deadline(Duration::MAX).spin(Duration::MAX).connect().unwrap();
    let boxes = scene(345);
    let expected = oracle::truth(&boxes).pairs;
    assert_eq!(pairs_of(&mut session, &boxes), expected);
    let mut frame = session.frame(boxes.len()).unwrap();
    frame.boxes_mut().copy_from_slice(&boxes);
    let mask = frame.submit().unwrap().wait_timeout(Duration::MAX).unwrap();
    assert_eq!(sorted(mask.to_vec()), expected);
}

#[test]
fn narrow_frames_lack_no_pair_and_are_those_of_their_form() {
    let mut session = in_process().connect().unwrap();
    let boxes = scene(345);
    let exact = oracle::truth(&boxes).pairs;
    for precision in [Precision::Q16(Bounds::around(&boxes)), Precision::F16, Precision::Exact] {
        let mut frame = session.narrow_frame(boxes.len(), precision).unwrap();
        frame.write(&boxes).unwrap();
        let mask = frame.submit().unwrap().wait().unwrap();
        let found = sorted(mask.to_vec());
        let form = precision.form();
        assert!(exact.iter().all(|pair| found.binary_search(pair).is_ok()), "{form}");
        assert!(form != BoxForm::F32 || found == exact);
        assert_eq!(mask.info().form, form.into());
    }
}

#[test]
fn filters_of_another_number_of_boxes_are_refused() {
    let mut session = in_process().connect().unwrap();
    let mut refused = |filter_data: usize, pair: [u32; 2]| {
        let mut rules = Rules::default();
        rules.filter_data = vec![FilterData::default(); filter_data];
        rules.lists.exclude(pair, true);
        let filters = Some(Arc::new(rules));
        let frame = session.frame(4).unwrap();
        frame.submit_with(&FrameOptions { filters, ..Default::default() }).err()
    };
    for filter_data in [1, 3, 5] {
        assert!(
            matches!(refused(filter_data, [0, 1]), Some(Error::FilterData { n: 4, .. })),
            "{filter_data}"
        );
    }
    for filter_data in [0, 4] {
        assert!(refused(filter_data, [3, 0]).is_none(), "{filter_data}");
        assert!(
            matches!(refused(filter_data, [9, 0]), Some(Error::Listed { index: 9, n: 4 })),
            "{filter_data}"
        );
    }
}

#[test]
fn frames_of_spheres_have_all_pairs_that_touch() {
    let mut session = in_process().connect().unwrap();
    for n in SIZES {
        let spheres: Vec<_> =
            (0..n).map(|i| Sphere::new([2.0 * i as f32, 0.0, 0.0], 1.0)).collect();
        let mut frame = session.sphere_frame(n).unwrap();
        frame.spheres_mut().copy_from_slice(&spheres);
        let found = sorted(frame.submit().unwrap().wait().unwrap().to_vec());
        let touching: Vec<_> = (1..n as u32).map(|i| [i - 1, i]).collect();
        assert_eq!(found, touching, "{n} spheres");
    }
}

#[test]
fn names_of_instances_are_checked_in_every_build() {
    let error = in_process().instance("no name").connect().unwrap_err();
    assert!(matches!(error, ConnectError::Instance(_)), "{error}");
}

#[test]
#[cfg(not(feature = "daemon"))]
fn without_a_transport_auto_is_in_process() {
    let mut session = Session::builder().connect().unwrap();
    assert_eq!(session.served_by(), ServedBy::InProcess);
    let boxes = scene(345);
    assert_eq!(pairs_of(&mut session, &boxes), oracle::truth(&boxes).pairs);
    let status = session.daemon_status().unwrap_err();
    assert!(matches!(&status, Error::Connect(ConnectError::NotBuiltIn)), "{status}");
}

#[test]
#[cfg(not(feature = "daemon"))]
fn without_a_transport_a_daemon_is_a_typed_error() {
    let error = Session::builder().backend(Backend::Daemon).connect().unwrap_err();
    assert!(matches!(error, ConnectError::NotBuiltIn), "{error}");
    let text = error.to_string();
    assert!(text.contains("feature `daemon`") && text.contains("Backend::InProcess"), "{text}");
}

#[test]
fn every_instruction_set_gives_the_same_pairs_in_the_same_order() {
    for n in SIZES {
        let boxes = scene(n);
        for encoding in Encoding::ALL {
            let mut found = Isa::ALL.into_iter().filter_map(AvailableIsa::new).map(|isa| {
                let builder = in_process().encoding(EncodingChoice::Only(encoding)).isa(isa);
                let mut session = builder.connect().unwrap();
                let mut frame = session.frame(n).unwrap();
                frame.boxes_mut().copy_from_slice(&boxes);
                let mask = frame.submit().unwrap().wait().unwrap();
                assert_eq!(mask.pairs().collect::<Vec<_>>(), mask.to_vec());
                let mut slices = Vec::new();
                mask.for_each_slice(|pairs| slices.extend_from_slice(pairs));
                assert_eq!(slices, mask.to_vec());
                mask.to_vec()
            });
            let first = found.next().unwrap();
            assert!(found.all(|pairs| pairs == first), "{n} boxes, {encoding}");
        }
    }
}

#[test]
fn frames_with_rules_have_the_pairs_that_these_let_meet() {
    for n in SIZES {
        let boxes = scene(n);
        let mut rules = Rules::default();
        rules.filter_data = (0..n as u32)
            .map(|at| FilterData::default().with_world(World([4, 2, -1, 2][at as usize % 4])))
            .map(|filter_data| filter_data.with_owner(Owner(filter_data.world.0 as u32 % 3)))
            .collect();
        let mut expected = oracle::truth(&boxes).pairs;
        expected.retain(|[a, b]| rules.meet(*a, *b));
        let options = FrameOptions { filters: Some(Arc::new(rules.clone())), ..Default::default() };
        for encoding in [EncodingChoice::Auto, EncodingChoice::Only(Encoding::Sparse)] {
            let mut session = in_process().encoding(encoding).connect().unwrap();
            let mut frame = session.frame(n).unwrap();
            frame.boxes_mut().copy_from_slice(&boxes);
            let mask = frame.submit_with(&options).unwrap().wait().unwrap();
            assert_eq!(sorted(mask.to_vec()), expected, "{n} boxes, {encoding}");
            if encoding == EncodingChoice::Auto && n > 3 {
                assert_eq!(mask.worlds().len(), 3);
                let of_world = |world: i32| mask.pairs_of_world(World(world)).unwrap();
                let lens = [-1, 2, 4].map(|world| of_world(world).len());
                assert_eq!(lens.iter().sum::<usize>(), expected.len());
                let is_of_2 =
                    |i: &u32| [World(2), World::ALL].contains(&rules.filter_data(*i).world);
                assert!(of_world(2).iter().flatten().all(is_of_2));
                assert_eq!(mask.pairs_of_world(World(3)), None);
            }
            // The next frame has none of it.
            let plain = pairs_of(&mut session, &boxes);
            assert_eq!(plain, oracle::truth(&boxes).pairs);
        }
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_frame_beyond_memory_is_an_error_and_the_session_goes_on() {
    // 96 GiB. Linux refuses what exceeds memory and swap together, unless it is set not to.
    let n = u32::MAX as usize;
    let memory = std::fs::read_to_string("/proc/meminfo").expect("the size of memory");
    let kib: u64 = memory
        .lines()
        .filter(|line| line.starts_with("MemTotal") || line.starts_with("SwapTotal"))
        .map(|line| line.split_whitespace().nth(1).expect("a size").parse::<u64>().expect("KiB"))
        .sum();
    let overcommit = std::fs::read_to_string("/proc/sys/vm/overcommit_memory").expect("a mode");
    let mut session = in_process().connect().unwrap();
    // The kernel would lend nine tenths of what is usable, and kill who touches it.
    let usable = pairmask_core::usable_memory::bytes().unwrap();
    let refused = session.frame((usable * 9 / 10) as usize / size_of::<Aabb>()).unwrap_err();
    assert!(matches!(refused, Error::NoMemory { .. } | Error::TooManyBoxes { .. }));
    if kib * 1024 < n as u64 * 24 && overcommit.trim() != "1" {
        let error = session.frame(n).expect_err("more than memory");
        assert!(matches!(error, Error::NoMemory { n: u32::MAX }), "{error}");
    }
    assert!(session.frame(3).is_ok() && session.frame(1_000_000).is_ok());
}
