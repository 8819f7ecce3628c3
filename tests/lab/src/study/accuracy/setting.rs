//! Settings: rows that answer the same question, of one scene, one size and one distance from the
//! origin.

use pairmaskd::plot::Unit;

use super::rows::AccuracyRow;

/// A setting with its rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting<'a> {
    /// The scene.
    pub scene: &'a str,
    /// Boxes.
    pub n: u32,
    /// Distance from the origin of a world in f64, if any. Rows of f32 boxes do not belong to such
    /// a setting.
    pub offset: Option<f64>,
    /// Its rows, in the order in which they were measured.
    pub rows: Vec<&'a AccuracyRow>,
}

impl Setting<'_> {
    /// Title for reports.
    pub fn title(&self) -> String {
        let far =
            self.offset.map_or_else(String::new, |offset| format!(", {offset:e} from the origin"));
        format!("{}, {} boxes{far}", self.scene, Unit::Count.text(f64::from(self.n)))
    }
}

/// Rows by setting: scenes in the order in which they were measured, then sizes, then distances.
pub fn settings(rows: &[AccuracyRow]) -> Vec<Setting<'_>> {
    let mut settings: Vec<Setting<'_>> = Vec::new();
    let mut scenes: Vec<&str> = Vec::new();
    for row in rows {
        if !scenes.contains(&row.scene.as_str()) {
            scenes.push(&row.scene);
        }
        let is_its = |s: &&mut Setting<'_>| {
            (s.scene, s.n, s.offset) == (row.scene.as_str(), row.n, row.offset)
        };
        match settings.iter_mut().find(is_its) {
            Some(setting) => setting.rows.push(row),
            None => settings.push(Setting {
                scene: &row.scene,
                n: row.n,
                offset: row.offset,
                rows: vec![row],
            }),
        }
    }
    let place = |s: &Setting<'_>| scenes.iter().position(|scene| *scene == s.scene);
    settings.sort_by(|a, b| {
        let distance = |s: &Setting<'_>| s.offset.unwrap_or(-1.0);
        (place(a), a.n).cmp(&(place(b), b.n)).then(distance(a).total_cmp(&distance(b)))
    });
    settings
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row;
    use super::*;

    #[test]
    fn rows_stand_with_those_of_their_question() {
        let of =
            |scene: &str, n, offset| AccuracyRow { scene: scene.to_owned(), n, offset, ..row() };
        let rows = [
            of("pile", 10_000, None),
            of("pile", 1000, Some(1e9)),
            of("cubes", 1000, None),
            of("pile", 1000, None),
            of("pile", 1000, None),
        ];
        let settings = settings(&rows);
        let titles: Vec<String> = settings.iter().map(Setting::title).collect();
        let far = "pile, 1K boxes, 1e9 from the origin";
        assert_eq!(titles, ["pile, 1K boxes", far, "pile, 10K boxes", "cubes, 1K boxes"]);
        assert_eq!(settings[0].rows.len(), 2);
    }
}
