//! Records that are text: tables that a command printed, and tables of runs in turns.

use super::shapes::{GpuSpheres, Spheres, TwoGpus};

/// The machine of a record: its first line.
pub fn machine_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default().trim_end_matches('.')
}

/// The table that `pairmask-lab spheres --gpu` prints.
///
/// # Errors
/// What is missing.
pub fn gpu_spheres(text: &str) -> Result<Spheres, &'static str> {
    let mut lines = text.lines().skip_while(|line| !line.contains("one by one"));
    lines.next().ok_or("no table of spheres on the GPU")?;
    let gpu_speed: Vec<GpuSpheres> = lines.map_while(sphere_row).collect();
    if gpu_speed.is_empty() {
        return Err("the table of spheres on the GPU has no row");
    }
    Ok(Spheres { gpu_speed, ..Spheres::default() })
}

/// Columns between bars: spheres and pairs; one by one, all pairs, tests a second, speed-up; others.
fn sphere_row(line: &str) -> Option<GpuSpheres> {
    let mut groups = line.split('|');
    let n = groups.next()?.split_whitespace().next()?.parse().ok()?;
    let figures: Vec<f64> =
        groups.next()?.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    // Large numbers of spheres have no frame of one by one: what is left cannot be told apart.
    let [plain, all_pairs, _tests, _speed_up] = figures[..] else {
        return Some(GpuSpheres { n, plain_fps: None, all_pairs_fps: None });
    };
    Some(GpuSpheres { n, plain_fps: Some(plain), all_pairs_fps: Some(all_pairs) })
}

/// The tables of one GPU beside two: a scene's name, the runs of each, ratios.
///
/// # Errors
/// What is missing.
pub fn two_gpus(text: &str) -> Result<Vec<TwoGpus>, &'static str> {
    let mut rows = Vec::new();
    let mut in_table = false;
    for line in text.lines() {
        if line.contains("one GPU") && line.contains("two GPUs") && line.contains("ratio") {
            in_table = true;
        } else if line.trim().is_empty() {
            in_table = false;
        } else if in_table {
            rows.push(scene_row(line).ok_or("a row of one GPU beside two has no runs")?);
        }
    }
    if rows.is_empty() { Err("no table of one GPU beside two") } else { Ok(rows) }
}

/// Columns are apart by two spaces at least, the runs of a column by one.
fn scene_row(line: &str) -> Option<TwoGpus> {
    let mut columns = line.split("  ").map(str::trim).filter(|column| !column.is_empty());
    Some(TwoGpus {
        scene: columns.next()?.to_owned(),
        one_ms: middle(columns.next()?)?,
        two_ms: middle(columns.next()?)?,
    })
}

/// The middle run, of an even number the mean of both.
fn middle(runs: &str) -> Option<f64> {
    let mut runs: Vec<f64> = runs.split(' ').filter_map(|run| run.parse().ok()).collect();
    runs.sort_by(f64::total_cmp);
    let (low, high) = (runs.len().checked_sub(1)? / 2, runs.len() / 2);
    Some(0.5 * (runs[low] + runs[high]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPHERES: &str = "\
NVIDIA X, driver 1; commit abc.

 spheres    pairs | one by one  all pairs    tests/s speed-up |       grid | right
      64       36 |     272554      21368     1.08e8     0.08 |      18575 | yes
   32768    17061 |                  1704    1.04e12          |      11312 | yes

The end.";

    #[test]
    fn a_printed_table_of_spheres_is_read() {
        assert_eq!(machine_line(SPHERES), "NVIDIA X, driver 1; commit abc");
        let rows = gpu_spheres(SPHERES).expect("a table").gpu_speed;
        assert_eq!(rows.len(), 2);
        assert_eq!((rows[0].n, rows[0].plain_fps), (64, Some(272_554.0)));
        assert_eq!((rows[0].all_pairs_fps, rows[1].all_pairs_fps), (Some(21_368.0), None));
        assert!(gpu_spheres("nothing").is_err());
        assert!(gpu_spheres("one by one |\n\n").is_err());
    }

    #[test]
    fn runs_in_turns_are_read_by_their_middle_one() {
        let text = "\
    scene         one GPU              two GPUs             ratio   bound
    uniform       0.961 0.929 0.923    0.808 0.809 0.799     0.87    0.74   missed
    ten million   9.331 9.298          7.258 7.254           0.78    0.74   missed

others";
        let rows = two_gpus(text).expect("a table");
        assert_eq!(rows[0], TwoGpus { scene: "uniform".into(), one_ms: 0.929, two_ms: 0.808 });
        assert_eq!(rows[1].scene, "ten million");
        assert!((rows[1].one_ms - 9.3145).abs() < 1e-9);
        assert!(two_gpus("others").is_err());
        assert!(two_gpus("one GPU  two GPUs  ratio\n  x").is_err());
    }
}
