//! Pipelines, one for each form of a stage, and their cache on disk.
#![allow(unsafe_code)]

use std::collections::HashMap;
use std::fs;
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ash::vk;
use naga::back::spv;
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use pairmask_shaders::{ComposedStage, Stage};

use super::{Gpu, GpuError};
use crate::user_folder;

/// Why a stage does not compile that asks for more or other than parts, numbered from 0.
pub(super) const WRONG_BINDINGS: &str = "it binds what it cannot be given";

/// Bytes of immediates that every Vulkan device has.
pub const IMMEDIATE_BYTES: u32 = 128;

/// `$XDG_CACHE_HOME/pairmask`, else `~/.cache/pairmask`.
pub fn user_cache_folder() -> Option<PathBuf> {
    user_folder("XDG_CACHE_HOME", ".cache")
}

pub struct Pipeline {
    gpu: Arc<Gpu>,
    label: &'static str,
    /// What it binds, by the names of its text.
    pub(super) bindings: Vec<String>,
    pub(super) set_layout: vk::DescriptorSetLayout,
    pub(super) layout: vk::PipelineLayout,
    pub(super) raw: vk::Pipeline,
}

impl Pipeline {
    fn new(
        gpu: &Arc<Gpu>,
        stage: &ComposedStage,
        bounded_loops: bool,
        checks: Checks,
        cache: vk::PipelineCache,
    ) -> Result<Arc<Self>, GpuError> {
        let (code, names) = compiled(stage, bounded_loops, checks)?;
        let raw = &gpu.raw;
        let mut made = Self {
            gpu: Arc::clone(gpu),
            label: stage.label,
            bindings: names,
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            raw: vk::Pipeline::null(),
        };
        let bindings: Vec<_> = (0..made.bindings.len() as u32)
            .map(|binding| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device outlives the layout; `made` destroys what was made, also on errors.
        made.set_layout = gpu.noticed(unsafe { raw.create_descriptor_set_layout(&info, None) })?;
        let set_layouts = [made.set_layout];
        let ranges = [vk::PushConstantRange::default()
            .stage_flags(vk::ShaderStageFlags::COMPUTE)
            .size(IMMEDIATE_BYTES)];
        let info = vk::PipelineLayoutCreateInfo::default()
            .set_layouts(&set_layouts)
            .push_constant_ranges(&ranges);
        // SAFETY: as above.
        made.layout = gpu.noticed(unsafe { raw.create_pipeline_layout(&info, None) })?;
        let info = vk::ShaderModuleCreateInfo::default().code(&code);
        // SAFETY: naga validated the module and wrote the code for this target.
        let module = gpu.noticed(unsafe { raw.create_shader_module(&info, None) })?;
        let stage_info = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main");
        let info = vk::ComputePipelineCreateInfo::default().stage(stage_info).layout(made.layout);
        // SAFETY: layout and module agree: `compiled` has the layout's bindings from the module.
        let created = unsafe { raw.create_compute_pipelines(cache, &[info], None) };
        // SAFETY: a pipeline does not need its module once it is made.
        unsafe { raw.destroy_shader_module(module, None) };
        let created = gpu.noticed(created.map_err(|(_, error)| error))?;
        made.raw = created.first().copied().unwrap_or_default();
        Ok(Arc::new(made))
    }

    pub fn label(&self) -> &'static str {
        self.label
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        let device = &self.gpu.raw;
        // SAFETY: frames keep their pipelines alive until they have ended; null handles are fine.
        unsafe {
            device.destroy_pipeline(self.raw, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

pub struct Pipelines {
    gpu: Arc<Gpu>,
    checks: Checks,
    made: HashMap<Stage, Arc<Pipeline>>,
    cache: vk::PipelineCache,
    file: Option<PathBuf>,
}

impl Pipelines {
    /// With the cache of `folder`, if there is a good one: else pipelines are compiled anew.
    pub fn new(gpu: &Arc<Gpu>, checks: Checks, folder: Option<&Path>) -> Result<Self, GpuError> {
        let file = folder.map(|f| f.join(format!("pipelines-{}.bin", gpu.cache_key)));
        let data = file.as_deref().and_then(load).unwrap_or_default();
        let info = vk::PipelineCacheCreateInfo::default().initial_data(&data);
        // SAFETY: the data was written by this driver version for this device (the file's name)
        // and is whole (its checksum); the driver checks its own header besides.
        let cache = gpu.noticed(unsafe { gpu.raw.create_pipeline_cache(&info, None) })?;
        Ok(Self { gpu: Arc::clone(gpu), checks, made: HashMap::new(), cache, file })
    }

    pub fn get(&mut self, stage: Stage) -> Result<Arc<Pipeline>, GpuError> {
        if let Some(pipeline) = self.made.get(&stage) {
            return Ok(Arc::clone(pipeline));
        }
        let (composed, bounded) = (stage.composed(), has_bounded_loops(stage));
        let pipeline = Pipeline::new(&self.gpu, &composed, bounded, self.checks, self.cache)?;
        self.made.insert(stage, Arc::clone(&pipeline));
        Ok(pipeline)
    }

    /// A pipeline of a stage that no engine has, compiled anew: for measurements, which keep it.
    pub fn compile(&self, stage: &ComposedStage) -> Result<Arc<Pipeline>, GpuError> {
        Pipeline::new(&self.gpu, stage, false, self.checks, self.cache)
    }

    /// Writes the cache to disk. A failure costs the next start its speed, and is logged only.
    pub fn save(&self) {
        let Some(file) = &self.file else { return };
        // SAFETY: the cache belongs to this device and no other thread has it.
        let data = unsafe { self.gpu.raw.get_pipeline_cache_data(self.cache) };
        let saved = data.map_err(std::io::Error::other).and_then(|data| store(file, &data));
        if let Err(error) = saved {
            log::warn!("the pipeline cache {} was not written: {error}", file.display());
        }
    }
}

impl Drop for Pipelines {
    fn drop(&mut self) {
        // SAFETY: pipelines do not need the cache they were made with.
        unsafe { self.gpu.raw.destroy_pipeline_cache(self.cache, None) };
    }
}

const CHECKSUM_BYTES: usize = 8;

/// FNV-1a: finds torn and flipped bytes, which is all that is asked of it.
fn checksum(data: &[u8]) -> [u8; CHECKSUM_BYTES] {
    let fold = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3);
    data.iter().fold(0xcbf2_9ce4_8422_2325, fold).to_le_bytes()
}

fn load(file: &Path) -> Option<Vec<u8>> {
    let mut bytes = fs::read(file).ok()?;
    let data = bytes.get(CHECKSUM_BYTES..)?;
    if checksum(data) != bytes[..CHECKSUM_BYTES] {
        log::warn!("the pipeline cache {} is damaged and not used", file.display());
        return None;
    }
    Some(bytes.split_off(CHECKSUM_BYTES))
}

/// Writes beside the file, then renames: a reader sees the old or the new one, never a part.
fn store(file: &Path, data: &[u8]) -> std::io::Result<()> {
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder)?;
    }
    let beside = file.with_extension(format!("{}.tmp", std::process::id()));
    let mut out =
        fs::OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&beside)?;
    out.write_all(&checksum(data))?;
    out.write_all(data)?;
    out.sync_all()?;
    fs::rename(&beside, file)
}

/// Whether stages check their indices and loops as they run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Checks {
    /// No checks: 1.4 to 2.2 times faster. Every index is in range by the plan. Loops of the grid's
    /// stages and of `write_list` stay bounded.
    #[default]
    Off,
    /// Indices are held within range and loops bounded. For tests: the answer must be the same.
    On,
}

/// Stages whose loops are bounded in production too (a counter a loop; the cost does not show in the
/// grid's).
///
/// Every loop of the grid ends by itself. All the same, on an H200 (driver 580.159.04) `grid_pairs`
/// with unbounded loops lost words of some scenes, the same ones each time (9 of 57 of the stress
/// scene `huge` with 43 boxes), and never ended on others (a mixed scene of 1,000). With bounded
/// loops and no other check it has every byte of its mirror; with checked indices and unbounded
/// loops it has not. So it is the driver's compiler that takes nested loops of different lengths
/// in one subgroup wrongly, and a counter that it cannot see through keeps it from doing so. The loops
/// of `write_list` are such loops too.
pub(super) const fn has_bounded_loops(stage: Stage) -> bool {
    matches!(stage, Stage::Grid(_) | Stage::WriteList | Stage::Scene(_) | Stage::SpherePairs(_))
}

/// A stage's code and the names of its bindings, with bounded loops where that or checks ask.
fn compiled(
    stage: &ComposedStage,
    bounded_loops: bool,
    checks: Checks,
) -> Result<(Vec<u32>, Vec<String>), GpuError> {
    let fault = |why| GpuError::Stage { stage: stage.label, why };
    let module =
        naga::front::wgsl::parse_str(&stage.wgsl).map_err(|_| fault("the text does not parse"))?;
    let bindings = binding_names(&module).ok_or(fault(WRONG_BINDINGS))?;
    // 64-bit integers: stages of measurements, on devices that have them.
    let capabilities = Capabilities::IMMEDIATES | Capabilities::SHADER_INT64;
    let info = Validator::new(ValidationFlags::all(), capabilities)
        .validate(&module)
        .map_err(|_| fault("the module is not valid"))?;
    let checked = checks == Checks::On;
    let policy = if checked { BoundsCheckPolicy::Restrict } else { BoundsCheckPolicy::Unchecked };
    let options = spv::Options {
        // Vulkan 1.1, which every driver in use has.
        lang_version: (1, 3),
        flags: spv::WriterFlags::empty(),
        bounds_check_policies: BoundsCheckPolicies {
            index: policy,
            buffer: policy,
            image_load: policy,
            binding_array: policy,
        },
        // Stages set what they read of workgroup memory. Not even for the checks: lavapipe turns
        // the zeroing of an array into a store an element and compiles for 20 s.
        zero_initialize_workgroup_memory: spv::ZeroInitializeWorkgroupMemoryMode::None,
        force_loop_bounding: checked || bounded_loops,
        emit_int_div_checks: checked,
        ..Default::default()
    };
    let code = spv::write_vec(&module, &info, &options, None);
    Ok((code.map_err(|_| fault("no SPIR-V for it"))?, bindings))
}

/// What a module binds, in order; `None` where that is not group 0 from 0 on, which a pipeline's layout is made for.
fn binding_names(module: &naga::Module) -> Option<Vec<String>> {
    let mut bound: Vec<_> = module
        .global_variables
        .iter()
        .filter_map(|(_, variable)| Some((variable.binding?, variable.name.clone()?)))
        .collect();
    bound.sort_unstable_by_key(|(binding, _)| (binding.group, binding.binding));
    let numbers = bound.iter().map(|(binding, _)| (binding.group, binding.binding));
    let are_counted = numbers.eq((0..bound.len() as u32).map(|binding| (0, binding)));
    are_counted.then(|| bound.into_iter().map(|(_, name)| name).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stored_cache_is_loaded_and_a_damaged_one_is_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("below").join("pipelines-test.bin");
        store(&file, b"data of a driver").expect("writes");
        assert_eq!(load(&file).as_deref(), Some(&b"data of a driver"[..]));
        let mut bytes = fs::read(&file).expect("just written");
        bytes[12] ^= 1;
        fs::write(&file, &bytes).expect("writes");
        assert_eq!(load(&file), None);
        fs::write(&file, b"short").expect("writes");
        assert_eq!(load(&file), None);
    }

    #[test]
    fn a_stage_whose_bindings_are_not_numbered_from_zero_is_refused() {
        let composed = Stage::PackDense.composed();
        let (_, names) = compiled(&composed, false, Checks::Off).expect("compiles");
        assert_eq!(names, ["matrix", "totals", "reports", "out_words"]);
        for (from, to) in [("binding(0)", "binding(4)"), ("binding(3)", "binding(5)")] {
            let other = ComposedStage { wgsl: composed.wgsl.replace(from, to), ..composed.clone() };
            let refused = GpuError::Stage { stage: other.label, why: WRONG_BINDINGS };
            assert_eq!(compiled(&other, false, Checks::Off), Err(refused));
        }
    }
}
