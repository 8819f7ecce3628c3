// The levels of a frame and the cell of a coordinate. Mirror: `mirror/grid_layout.rs`. That
// overlapping boxes are in neighbouring cells regardless of what f32 rounds is proven in the daemon's `axis.rs`.

struct GridLevel {
    // Where cell 0 is centred.
    origin: vec3<f32>,
    // Number of the level's first cell in the table of all levels.
    first_cell: u32,
    // Cells per unit.
    scale: vec3<f32>,
    cell_count: u32,
    // Lowest and highest cell number.
    low: vec3<f32>,
    padding_low: u32,
    high: vec3<f32>,
    padding_high: u32,
    // Cell number to cell of the table: an AND.
    fold: vec3<i32>,
    padding_fold: u32,
    // Cells of the table along each axis.
    count: vec3<u32>,
    // Bit a: axis a is folded, so that its last cell is beside its first.
    wraps: u32,
}

// Where worlds have cells of their own, one world behind the other.
struct GridWorlds {
    // Cells of a world: its levels, and its boxes that lie there by their index.
    cells: u32,
    // Cells of its giants, and as many of its boxes that overlap nothing.
    parking: u32,
    // Worlds. One, and so are the cells, where none is apart.
    count: u32,
    padding: u32,
}

struct GridLayout {
    // Levels in use, finest first.
    level_count: u32,
    // First cell of the boxes that no level takes; they look at everything. Here and below, cells are
    // those of the first world.
    first_giant: u32,
    // First cell of the boxes that overlap nothing.
    first_nothing: u32,
    // One past the last cell of all worlds.
    cell_end: u32,
    levels: array<GridLevel, GRID_LEVELS>,
    worlds: GridWorlds,
}

// 1.5 * 2^23: adding it rounds a number of magnitude below 2^22 to an integer.
const ROUND: f32 = 12582912.0;
// Bits of 2^-60 and 2^60. Between them, no step below meets a subnormal or an infinity.
const TINY_BITS: u32 = 0x21800000u;
const HUGE_BITS: u32 = 0x5d800000u;

// The number of a key, tiny ones flushed to 0 and huge ones held: monotone.
fn plain(key: i32) -> f32 {
    let bits = bitcast<u32>(order_key(bitcast<u32>(key)));
    let magnitude = bits & MAGNITUDE_BITS;
    let held = select(min(magnitude, HUGE_BITS), 0u, magnitude < TINY_BITS);
    return bitcast<f32>(held | (bits & SIGN_BIT));
}

fn plain3(keys: vec3<i32>) -> vec3<f32> {
    return vec3<f32>(plain(keys.x), plain(keys.y), plain(keys.z));
}

// Unfolded cell numbers of a point.
fn cells_of(level: GridLevel, point: vec3<f32>) -> vec3<i32> {
    let cells = (point - level.origin) * level.scale;
    let held = min(max(cells, level.low), level.high);
    return bitcast<vec3<i32>>(held + vec3<f32>(ROUND)) - vec3<i32>(bitcast<i32>(ROUND));
}

// The cell of the table at folded cell numbers.
fn cell_at(level: GridLevel, cell: vec3<i32>) -> u32 {
    let folded = vec3<u32>(cell & level.fold);
    return level.first_cell + (folded.z * level.count.y + folded.y) * level.count.x + folded.x;
}
