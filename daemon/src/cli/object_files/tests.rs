use std::path::PathBuf;

use clap::ValueEnum;
use tempfile::TempDir;

use super::*;

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary directory"))
    }

    fn file(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).expect("the directory can be written");
        path
    }

    fn boxes(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<Vec<Aabb>, String> {
        read(&self.file(name, bytes))
    }
}

fn read<T: FileObject>(path: &Path) -> Result<Vec<T>, String> {
    let file = ObjectFile::open(path).map_err(|error| error.to_string())?;
    let (count, objects) = (file.count(), file.read().map_err(|error| error.to_string())?);
    assert_eq!(count, objects.len());
    Ok(objects)
}

fn bits<T: FileObject>(objects: &[T]) -> &[u32] {
    bytemuck::cast_slice(objects)
}

fn npy(descr: &str, rows: usize, columns: usize, numbers: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    npy::write_header(&mut file, descr, rows, columns).expect("memory");
    file.extend_from_slice(numbers);
    file
}

/// Numbers at which text goes wrong first.
const HARD: [f32; 12] = [
    0.0,
    -0.0,
    0.1,
    -1.0 / 3.0,
    f32::MAX,
    f32::MIN_POSITIVE,
    1e-45,
    16_777_216.0,
    f32::INFINITY,
    f32::NEG_INFINITY,
    123_456.79,
    f32::EPSILON,
];

fn reads_back<T: FileObject>(numbers: &[f32]) {
    let folder = Folder::new();
    let objects: &[T] = bytemuck::cast_slice(numbers);
    for format in Format::value_variants() {
        for count in [0, 1, objects.len()] {
            let mut file = Vec::new();
            write_objects(&mut file, *format, &objects[..count]).expect("memory");
            let end = match format {
                Format::Raw => "f32",
                Format::Text => "txt",
                Format::Csv => "CSV",
                Format::Npy => "npy",
            };
            let path = folder.file(&format!("objects.{end}"), file);
            assert_eq!(Format::of(&path), *format);
            let got = read::<T>(&path).expect("what was written");
            assert_eq!(bits(&got), bits(&objects[..count]), "{format:?}");
        }
    }
}

#[test]
fn every_format_reads_what_it_wrote() {
    reads_back::<Aabb>(&HARD);
    reads_back::<Sphere>(&HARD);
}

#[test]
fn pairs_are_written_in_every_format() {
    let pairs = [[0, 1], [7, u32::MAX]];
    let written = |format| {
        let mut file = Vec::new();
        write_pairs(&mut file, format, &pairs).expect("memory");
        file
    };
    let raw = written(Format::Raw);
    assert_eq!(raw, bytemuck::cast_slice::<_, u8>(&pairs));
    assert_eq!(written(Format::Text), b"0 1\n7 4294967295\n");
    assert_eq!(written(Format::Csv), b"a,b\n0,1\n7,4294967295\n");
    assert_eq!(written(Format::Npy), npy("<u4", 2, 2, &raw));
}

#[test]
fn tables_are_read_with_names_comments_and_foreign_line_ends() {
    let folder = Folder::new();
    let two = [Aabb::new([0.0; 3], [1.0; 3]), Aabb::new([-2.5; 3], [1e3; 3])];
    for (name, text) in [
        (
            "a.csv",
            "\u{feff}min.x,min.y,min.z,max.x,max.y,max.z\r\n0,0,0,1,1,1\r\n-2.5,-2.5,-2.5,1e3,1e3,1e3",
        ),
        ("b.csv", "0,0,0,1,1,1\n\n# far\n -2.5, -2.5,-2.5 ,1e3,1000,1000.0\n"),
        ("c.txt", "# boxes\n0 0 0 1 1 1\n\t-2.5  -2.5 -2.5 1e3 1000 +1000.0 \n"),
    ] {
        assert_eq!(folder.boxes(name, text).as_deref(), Ok(&two[..]), "{name}");
    }
    for name in ["empty.csv", "empty.txt"] {
        assert_eq!(folder.boxes(name, "").as_deref(), Ok(&[][..]));
    }
}

#[test]
fn a_mistake_in_a_table_is_named_by_line_and_column() {
    let folder = Folder::new();
    let long = "1 ".repeat(3000);
    for (name, text, expected) in [
        ("a.csv", "0,0,0,1,1,1\n0,0,o,1,1,1\n", "line 2, column 3: 'o' is no number"),
        // Not a line of names: it has numbers.
        ("b.csv", "0,0,o,1,1,1\n", "line 1, column 3: 'o' is no number"),
        ("c.csv", "a,b\nc,d\n", "line 2, column 1: 'c' is no number"),
        ("d.csv", "0,0,0,1,1,\n", "line 1, column 6: '' is no number"),
        (
            "e.txt",
            "0 0 0 1 1\n",
            "line 1: there are 5 columns, where 6 make one of the boxes: min.x",
        ),
        ("f.txt", "\n0 0 0 1 1 1 1\n", "line 2: there are 7 columns"),
        ("g.txt", "0,0,0,1,1,1\n", "line 1, column 1: '0,0,0,1,1,1' is no number"),
        ("h.txt", &long, "line 1: it is longer than 4096 bytes"),
    ] {
        let error = folder.boxes(name, text).expect_err(name);
        assert!(error.contains(&format!("{name}: {expected}")), "{error}");
    }
    let error = folder.boxes("i.txt", [0xff, 0xfe, b'\n']).expect_err("no text");
    assert!(error.contains("line 1, column 1"), "{error}");
    let path = folder.file("spheres.csv", "0,0,0,1,1,1\n");
    let error = read::<Sphere>(&path).expect_err("boxes");
    assert!(error.contains("4 make one of the spheres: x y z radius"), "{error}");
}

#[test]
fn arrays_of_f64_are_rounded_outward() {
    let folder = Folder::new();
    let (low, high) = (0.1_f64, 0.7_f64);
    let numbers = [low, low, low, high, high, high];
    let boxes = folder.boxes("boxes.npy", npy("<f8", 1, 6, bytemuck::cast_slice(&numbers)));
    let b = boxes.expect("a box")[0];
    assert!(f64::from(b.min[0]) < low && f64::from(b.min[0].next_up()) > low, "{b:?}");
    assert!(f64::from(b.max[0]) > high && f64::from(b.max[0].next_down()) < high, "{b:?}");
    let path = folder.file("spheres.npy", npy("<f8", 1, 4, bytemuck::cast_slice(&numbers[..4])));
    let sphere = read::<Sphere>(&path).expect("a sphere")[0];
    assert_eq!(sphere, Sphere::outward_from_f64([low; 3], high));
}

#[test]
fn arrays_that_are_not_boxes_say_what_to_do() {
    let folder = Folder::new();
    let numbers = [0; 48];
    for (file, expected) in [
        (npy("<f4", 2, 6, &numbers[..24]), "says 2 rows, and 1 are there: is it truncated?"),
        (npy("<f4", 1, 6, &numbers), "says 1 rows, and 2 are there"),
        (npy("<f8", 2, 6, &numbers), "says 2 rows, and 1 are there"),
        (npy("<f8", 1, 6, &[0; 96]), "says 1 rows, and 2 are there"),
        (npy("<f8", 1, 6, &numbers[..40]), "says 1 rows, and 0 are there"),
        (npy("<f4", usize::MAX, 6, &numbers[..24]), "rows, and 1 are there"),
        (npy("<f4", 1, 6, &numbers[..23]), "is it truncated"),
        (
            npy("<f4", 2, 3, &numbers[..24]),
            "its shape is (2, 3), where (n, 6) is read: min.x min.y",
        ),
        (npy("<i8", 1, 6, &numbers), "its numbers are '<i8', of which '<f4' and '<f8' are read"),
        (b"\x93NUMPY\x03\0\0\0".to_vec(), "it has .npy format 3.0"),
        (b"\x93NUMPY\x02\0\xff\xff\xff\xff".to_vec(), "its .npy header is not as numpy writes it"),
        (b"\x93NUMPY\x01\0\x10\0{".to_vec(), "it is no .npy file"),
        (vec![0; 48], "it is no .npy file"),
        (Vec::new(), "it is no .npy file"),
    ] {
        let error = folder.boxes("boxes.npy", file).expect_err(expected);
        assert!(error.contains("boxes.npy") && error.contains(expected), "{error}");
    }
    let second = [b"\x93NUMPY\x02\0", &64_u32.to_le_bytes()[..]].concat();
    let text = format!("{:<64}", "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 6)}");
    let file = [&second, text.as_bytes(), &numbers[..24]].concat();
    assert_eq!(folder.boxes("boxes.npy", file), Ok(vec![Aabb::default()]));
}
