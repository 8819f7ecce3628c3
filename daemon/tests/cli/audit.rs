//! `serve --audit`: frames are checked again, and right ones pass.

use pairmask_core::Encoding;
use pairmask_tests::audited::{Shape, audit};

use crate::support::Pairmaskd;

#[test]
fn right_frames_pass() {
    for shape in [Shape::Boxes, Shape::Spheres, Shape::Sets, Shape::Queries] {
        let (reported, log) = audit::<Pairmaskd>(Encoding::Sparse, shape);
        assert_eq!((&reported["missed"], &reported["extra"]), (&0.into(), &0.into()), "{reported}");
        // After the scene's one edit nothing is compared: what its client took is not known yet.
        let edits = u64::from(shape == Shape::Queries);
        assert_eq!(
            reported["pairs"].as_u64(),
            Some((reported["frames"].as_u64().unwrap() - edits) * 780)
        );
        assert_eq!(reported["one_in"], 1);
        assert!(!log.contains("audit"), "{log}");
    }
}
