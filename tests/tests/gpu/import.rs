//! Zero copy: boxes and masks in shared memory that the GPU has imported.

use std::fs::OpenOptions;
use std::path::PathBuf;

use pairmask_tests::frame_memory::SharedReply;
use pairmask_tests::gpu::{engine, open};
use pairmask_tests::naive_decoder::sections;
use pairmask_tests::naive_modes;
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::{
    AllPairs, EngineOptions, HostImport, ImportError, ImportId, ReadWriteMapping, SharedImports,
    Upload,
};
use rustix::mm::{MapFlags, ProtFlags};

const PAGE: usize = 4096;

/// A segment of boxes as a client and the daemon have it: written through one mapping, seen through another, which is
/// read-only.
struct Segment {
    path: PathBuf,
    writer: ReadWriteMapping,
    seen: *mut u8,
    bytes: usize,
}

impl Segment {
    fn new(name: &str, bytes: usize) -> Self {
        let path = PathBuf::from(format!("/dev/shm/pairmask-{name}-{}", std::process::id()));
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create_new(true)
            .open(&path)
            .expect("shared memory is writable");
        file.set_len(bytes as u64).expect("room");
        let writer = ReadWriteMapping::of_file(&file, 0, bytes).expect("maps");
        let (prot, flags) = (ProtFlags::READ, MapFlags::SHARED);
        // SAFETY: the kernel chooses a free address.
        #[allow(unsafe_code)]
        let seen = unsafe { rustix::mm::mmap(std::ptr::null_mut(), bytes, prot, flags, &file, 0) };
        let seen = seen.expect("maps").cast();
        Self { path, writer, seen, bytes }
    }

    fn write<'a>(&self, offset: usize, boxes: impl Into<BoxSlice<'a>>) {
        let bytes = boxes.into().as_bytes();
        assert!(offset + bytes.len() <= self.bytes);
        let to = self.writer.pointer().as_ptr();
        // SAFETY: in range (above); no reference to these bytes is live.
        #[allow(unsafe_code)]
        unsafe {
            std::ptr::copy_nonoverlapping(bytes.as_ptr(), to.add(offset), bytes.len());
        }
    }

    fn boxes(&self, offset: usize, n: usize) -> &[Aabb] {
        self.narrow(BoxForm::F32, offset, n).as_f32().expect("of f32")
    }

    fn narrow(&self, form: BoxForm, offset: usize, n: usize) -> BoxSlice<'_> {
        let bytes = n * form.box_bytes();
        assert!(offset + bytes <= self.bytes);
        // SAFETY: in range (above); written only by `write`, never while this lives.
        #[allow(unsafe_code)]
        let bytes = unsafe { std::slice::from_raw_parts(self.seen.add(offset), bytes) };
        BoxSlice::new(form, bytes).expect("an aligned offset")
    }
}

impl Drop for Segment {
    fn drop(&mut self) {
        // SAFETY: mapped by `new`; no slice of it outlives the segment.
        #[allow(unsafe_code)]
        unsafe {
            rustix::mm::munmap(self.seen.cast(), self.bytes).expect("was mapped");
        }
        std::fs::remove_file(&self.path).expect("was made");
    }
}

fn imported(engine: &mut AllPairs, segment: &Segment) -> ImportId {
    engine
        .import_boxes(segment.seen as usize, segment.bytes)
        .unwrap_or_else(|error| panic!("shared memory must import here: {error}"))
}

/// Culls a scene that lies in a segment, and checks the answer.
fn check(engine: &mut AllPairs, segment: &Segment, offset: usize, seed: u64) {
    let scene = stress_scenes::ALL[0].boxes(345, seed);
    segment.write(offset, &scene);
    let mut reply = HeapReply::new();
    let input = CullInput::boxes(segment.boxes(offset, 345));
    let report = engine.cull(&input, &mut reply).expect("culls");
    let truth = oracle::truth(&scene);
    assert_eq!(check_reply(reply.words(), &report, 345, Encoding::Sparse, &truth), Ok(()));
}

#[test]
fn imported_and_staged_memory_give_the_same_bytes() {
    let boxes = Segment::new("boxes", 256 * PAGE);
    let imports = SharedImports::default();
    let mut zero_copy = engine(EngineOptions { imports: imports.clone(), ..Default::default() });
    let mut staged = engine(EngineOptions::default());
    imported(&mut zero_copy, &boxes);
    let (mut memory, watcher) = SharedReply::new(zero_copy.gpu(), &imports, 2048);
    for n in [2u32, 33, 345, 1234, 4096] {
        for (scene, offset) in stress_scenes::ALL.iter().zip([0, PAGE, 3 * PAGE].iter().cycle()) {
            if n > 1234 && scene.is_quadratic {
                continue;
            }
            let scene_boxes = scene.boxes(n, 13);
            boxes.write(*offset, &scene_boxes);
            for encoding in Encoding::ALL {
                let seen = boxes.boxes(*offset, n as usize);
                memory.first = *offset / 4;
                watcher.fill(0xdead_beef);
                let a = zero_copy
                    .cull(&CullInput::boxes(seen).encoding(encoding), &mut memory)
                    .expect("culls");
                let mut heap = HeapReply::new();
                let b = staged
                    .cull(&CullInput::boxes(&scene_boxes).encoding(encoding), &mut heap)
                    .expect("culls");
                assert_eq!(a.shape, b.shape, "{scene:?}, {n}");
                let a = sections(memory.words(), &a.shape);
                let b = sections(heap.words(), &b.shape);
                assert!(a.expect("in range") == b.expect("in range"), "{scene:?}, {n}, {encoding}");
            }
        }
    }
}

/// Small scenes are imported too, and no word beyond the segment's end is read.
#[test]
fn narrow_boxes_are_read_from_imported_memory() {
    let upload = Some(Upload::KernelReads);
    let mut engine = engine(EngineOptions { upload, ..EngineOptions::default() });
    let segment = Segment::new("narrow", 256 * PAGE);
    imported(&mut engine, &segment);
    // 213 boxes of 6 bytes end in the middle of the last word.
    let last = 256 * PAGE - 2 - 213 * BoxForm::Q8.box_bytes();
    assert!(last.is_multiple_of(256));
    let mut reply = HeapReply::new();
    let slots = [(2, 0), (33, PAGE), (345, 256), (1233, 3 * PAGE), (213, last), (5, PAGE + 6)];
    for (n, offset) in slots {
        let scene = stress_scenes::named("empty mixed in").boxes(n, 3);
        let bounds = Bounds::around(&scene);
        for precision in [Precision::Q8(bounds), Precision::Q16(bounds), Precision::F16] {
            let form = precision.form();
            if offset == last && form != BoxForm::Q8 {
                continue;
            }
            segment.write(offset, NarrowMemory::write(&precision, &scene).boxes());
            let seen = segment.narrow(form, offset, n as usize);
            let report = engine.cull(&CullInput::boxes(seen), &mut reply).expect("culls");
            let truth = naive_modes::truth(&scene, &precision);
            let found = check_reply(reply.words(), &report, n, Encoding::Sparse, &truth);
            assert_eq!(found, Ok(()), "{n} boxes at {offset}, {precision:?}");
        }
    }
}

#[test]
fn a_dropped_import_is_staged_and_memory_at_the_same_address_is_read_anew() {
    let mut engine = engine(EngineOptions::default());
    let segment = Segment::new("discarded", 16 * PAGE);
    let id = imported(&mut engine, &segment);
    for seed in [1, 2] {
        check(&mut engine, &segment, 0, seed);
        engine.discard(id);
    }
}

#[test]
fn boxes_off_the_binding_grid_are_staged() {
    let mut engine = engine(EngineOptions::default());
    let segment = Segment::new("odd", 16 * PAGE);
    imported(&mut engine, &segment);
    check(&mut engine, &segment, PAGE + 4, 3);
}

#[test]
fn without_the_extension_import_is_refused_and_staging_serves() {
    let gpu = open(HostImport::Never);
    let mut engine = AllPairs::new(&gpu, EngineOptions::default()).expect("an engine");
    let segment = Segment::new("refused", 16 * PAGE);
    let refused = engine.import_boxes(segment.seen as usize, segment.bytes);
    assert!(matches!(refused, Err(ImportError::Gpu(_))), "{refused:?}");
    check(&mut engine, &segment, 0, 4);
}

#[test]
fn private_memory_is_not_imported() {
    let mut engine = engine(EngineOptions::default());
    let heap = vec![0u8; 64 * PAGE];
    let refused = engine.import_boxes(heap.as_ptr() as usize, heap.len());
    assert!(matches!(refused, Err(ImportError::Segment(_))), "{refused:?}");
}
