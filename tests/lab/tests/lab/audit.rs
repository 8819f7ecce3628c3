//! The daemon's auditor, end to end: it notices a daemon that loses pairs.

use pairmask_core::Encoding;
use pairmask_tests::audited::{Shape, audit};

use super::support::LosingDaemon;

#[test]
fn a_broken_engine_is_counted() {
    for (encoding, shape) in [
        (Encoding::Dense, Shape::Boxes),
        (Encoding::Sparse, Shape::Boxes),
        (Encoding::Sparse, Shape::Spheres),
        (Encoding::Dense, Shape::Sets),
        (Encoding::List, Shape::Sets),
        (Encoding::Sparse, Shape::Queries),
        (Encoding::List, Shape::Queries),
    ] {
        let (reported, log) = audit::<LosingDaemon>(encoding, shape);
        let edits = u64::from(shape == Shape::Queries);
        let frames = reported["frames"].as_u64().expect("a count") - edits;
        assert_eq!(reported["missed"], frames, "a pair is lost in every frame: {reported}");
        assert_eq!(reported["extra"], 0);
        assert!(log.contains("1 missed and 0 extra pairs"), "{log}");
    }
}
