use super::*;
use crate::sphere::Sphere;
use crate::sphere::tests::hard_spheres;

#[test]
fn every_kernel_says_what_single_pairs_say() {
    for isa in Isa::ALL.into_iter().filter_map(AvailableIsa::new) {
        for n in [0usize, 1, 2, 63, 64, 65, 130, 345] {
            let spheres: Vec<Sphere> = hard_spheres(n, n as u64 + 3);
            let mut columns = BallColumns::default();
            columns.ingest(&spheres);
            for row in 0..n {
                let mut found = Vec::new();
                search(&columns, row, isa, &mut |word, bits| {
                    assert_ne!(bits, 0);
                    found.extend((0..64).filter(|t| bits >> t & 1 == 1).map(|t| 64 * word + t));
                });
                let overlap = |column: &usize| spheres[row].overlaps(&spheres[*column]);
                let expected: Vec<usize> = (row + 1..n).filter(overlap).collect();
                assert_eq!(found, expected, "{isa:?}, row {row} of {n}");
            }
        }
    }
}
