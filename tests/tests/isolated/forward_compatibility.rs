//! Answers of later daemons, and malformed answers. A mask that this build can read is served. Any
//! other answer leads to an answer in process, or to an error that names the cause.

use log::LevelFilter;
use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{Census, EngineId, EngineTimes, SkipMeter};
use pairmask_tests::prelude::*;
use pairmask_tests::refuser::{beside_daemon, fields_of};
use pairmask_transport::RuntimeDir;
use pairmask_wire::{
    ReplyError, RequestHeader, ResponseHeader, Section, SectionKind, Version, response_ok,
};

use crate::library_log;

const N: BoxCount = BoxCount::new(3);

/// The right answer to the frames of [`ask`]: the pair (0, 1).
fn right(header: &RequestHeader, words: &mut [u32]) -> ResponseHeader {
    words[0] = 1;
    let report = CullReport {
        shape: MaskShape::dense(N),
        census: Census::default(),
        pair_count: 1,
        skipped: SkipMeter::default(),
        times: EngineTimes::default(),
    };
    response_ok(&fields_of(header), EngineName::CpuBrute, 1, &report, &StageTimes::default())
}

fn ask(session: &mut Session) -> Result<PairMask, Error> {
    let mut frame = session.frame(N.len()).unwrap();
    assert!(frame.is_shared(), "the daemon is asked all the same");
    frame.boxes_mut().copy_from_slice(&[at(0.0), at(0.5), at(9.0)]);
    frame.submit().unwrap().wait()
}

/// A session of the daemon alone.
fn strict(dir: &RuntimeDir) -> SessionBuilder {
    Session::builder().runtime_dir(dir.clone()).backend(Backend::Daemon)
}

/// The same that asks for lists.
fn of_lists(dir: &RuntimeDir) -> Session {
    strict(dir).encoding(EncodingChoice::Only(Encoding::List)).connect().unwrap()
}

/// Runs `test` beside a daemon that gives the right answer, changed.
fn beside(change: fn(&mut ResponseHeader), test: impl FnOnce(&RuntimeDir)) {
    let changed = move |header: &RequestHeader, words: &mut [u32]| {
        let mut response = right(header, words);
        change(&mut response);
        response
    };
    beside_daemon(Version::CURRENT, changed, test);
}

#[test]
fn an_engine_of_a_later_daemon_is_served_and_named_by_its_number() {
    let _alone = crate::alone();
    beside(
        |header| header.engine = 17,
        |dir| {
            for backend in [Backend::Daemon, Backend::Auto] {
                let mut session = strict(dir).backend(backend).connect().unwrap();
                let mask = ask(&mut session).unwrap();
                assert_eq!(mask.info().served_by, ServedBy::Daemon, "{backend}");
                assert_eq!(mask.info().engine, EngineId::Unknown(17), "{backend}");
                assert_eq!(mask.info().engine.to_string(), "engine 17");
                assert_eq!(mask.to_vec(), [[0, 1]], "{backend}");
            }
        },
    );
}

#[test]
fn sections_that_may_be_passed_over_are() {
    let _alone = crate::alone();
    beside(
        |header| {
            header.version_minor = 99;
            header.sections[7] = Section { kind: 77, flags: 0, offset: 64, bytes: 4 };
            header.flags = u32::MAX;
        },
        |dir| {
            let mask = ask(&mut strict(dir).connect().unwrap()).unwrap();
            assert_eq!(mask.to_vec(), [[0, 1]]);
        },
    );
}

/// A change of the right answer, and the error that it leads to.
type Case = (fn(&mut ResponseHeader), fn(&ReplyError) -> bool, &'static str);

/// Every kind of malformed or unknown answer, of a later daemon or a broken one.
const CASES: [Case; 10] = [
    (|h| h.status = 55, |e| matches!(e, ReplyError::UnknownStatus { found: 55 }), "status 55"),
    (
        |h| h.encoding = 66,
        |e| matches!(e, ReplyError::UnknownEncoding { found: 66 }),
        "encoding 66",
    ),
    (
        |h| h.sections[1] = Section { kind: 77, flags: Section::REQUIRED, offset: 0, bytes: 4 },
        |e| matches!(e, ReplyError::UnknownSection { found: 77 }),
        "section 77",
    ),
    (|h| h.status = 1, |e| matches!(e, ReplyError::Status { .. }), "bad-request"),
    (|h| h.status = 2, |e| matches!(e, ReplyError::Status { .. }), "version-mismatch"),
    (|h| h.version_major = 9, |e| matches!(e, ReplyError::Envelope), "wire version"),
    (|h| h.frame += 1, |e| matches!(e, ReplyError::Frame { .. }), "frame"),
    (|h| h.box_count += 1, |e| matches!(e, ReplyError::Malformed { .. }), "box count"),
    (|h| h.sections[0].offset = 4096, |e| matches!(e, ReplyError::Malformed { .. }), "dense words"),
    (
        |h| h.sections[0].kind = SectionKind::Order as u32,
        |e| matches!(e, ReplyError::Malformed { .. }),
        "dense words",
    ),
];

#[test]
fn what_is_no_answer_is_answered_in_process_or_named() {
    let _alone = crate::alone();
    library_log::capture(LevelFilter::Warn);
    for (change, is_named, said) in CASES {
        beside(change, |dir| {
            let error = ask(&mut strict(dir).connect().unwrap()).unwrap_err();
            assert!(error.to_string().contains(said), "{said}: {error}");
            let Error::Reply(error) = error else { panic!("{said}: {error:?}") };
            assert!(is_named(&error), "{said}: {error:?}");

            let mut session = strict(dir).backend(Backend::Auto).connect().unwrap();
            library_log::take_captured();
            for _ in 0..5 {
                let mask = ask(&mut session).unwrap_or_else(|e| panic!("{said}: {e}"));
                assert_eq!(mask.info().served_by, ServedBy::InProcess, "{said}");
                assert_eq!(mask.to_vec(), [[0, 1]], "{said}");
            }
            // Other tests of this file have daemons with right answers, which log no warning.
            let warned = library_log::take_captured();
            assert!(warned.len() == 1 && warned[0].1.contains(said), "{said}: {warned:?}");
        });
    }
}

fn right_list(header: &RequestHeader, words: &mut [u32]) -> ResponseHeader {
    let mut response = right(header, words);
    words[..2].copy_from_slice(&[0, 1]);
    response.encoding = Encoding::List as u32;
    response.sections[0] = Section::required(SectionKind::ListPairs, 0, 8);
    response
}

#[test]
fn a_list_is_asked_for_and_read() {
    let _alone = crate::alone();
    let asked_for_a_list = |header: &RequestHeader, words: &mut [u32]| {
        assert_eq!(header.encoding, Encoding::List as u32);
        right_list(header, words)
    };
    beside_daemon(Version::CURRENT, asked_for_a_list, |dir| {
        let mask = ask(&mut of_lists(dir)).unwrap();
        assert_eq!((mask.encoding(), mask.to_vec()), (Encoding::List, vec![[0, 1]]));
        assert!(mask.contains(1, 0) && !mask.contains(1, 2));
    });
}

#[test]
fn a_list_whose_pairs_are_none_gives_none() {
    let _alone = crate::alone();
    // Three entries: a box that is not there, a pair the wrong way round, a pair.
    let forged = |header: &RequestHeader, words: &mut [u32]| {
        let mut response = right_list(header, words);
        words[..6].copy_from_slice(&[0, 3, 2, 1, 0, 2]);
        response.sections[0].bytes = 24;
        response
    };
    beside_daemon(Version::CURRENT, forged, |dir| {
        let mask = ask(&mut strict(dir).connect().unwrap()).unwrap();
        assert_eq!(mask.to_vec(), [[0, 2]]);
        assert_eq!(mask.view().count(), 1);
        assert!(mask.view().verify().is_err());
    });
}

#[test]
fn a_list_that_is_malformed_is_named() {
    let _alone = crate::alone();
    let cases: [fn(&mut ResponseHeader); 4] = [
        |h| h.sections[0].bytes = 4,
        |h| h.sections[0].bytes = 1 << 40,
        |h| h.sections[0].offset = u64::MAX - 7,
        |h| h.sections[0].kind = SectionKind::DenseWords as u32,
    ];
    for change in cases {
        let forged = move |header: &RequestHeader, words: &mut [u32]| {
            let mut response = right_list(header, words);
            change(&mut response);
            response
        };
        beside_daemon(Version::CURRENT, forged, |dir| {
            let error = ask(&mut strict(dir).connect().unwrap()).unwrap_err();
            assert!(matches!(error, Error::Reply(ReplyError::Malformed { .. })), "{error:?}");
            assert!(error.to_string().contains("list pairs"), "{error}");
        });
    }
}
