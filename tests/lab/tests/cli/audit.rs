//! The daemon's auditor, end to end: it notices a daemon that loses pairs.

use pairmask_core::Encoding;
use pairmask_tests::audited::{Shape, audit};

use crate::support::LosingDaemon;

#[test]
fn a_broken_engine_is_counted() {
    for (encoding, shape) in [
        (Encoding::Dense, Shape::Boxes),
        (Encoding::Sparse, Shape::Boxes),
        (Encoding::Sparse, Shape::Spheres),
    ] {
        let (told, log) = audit::<LosingDaemon>(encoding, shape);
        assert_eq!(told["missed"], told["frames"], "a pair is lost in every frame: {told}");
        assert_eq!(told["extra"], 0);
        assert!(log.contains("1 missed and 0 extra pairs"), "{log}");
    }
}
