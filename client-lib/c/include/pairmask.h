/* Pairmask: which of many boxes overlap. Broad-phase collision culling, exact and fast, in this process or by
 * a daemon through shared memory.
 *
 *     pm_session session;
 *     pm_frame frame;
 *     pm_pending pending;
 *     pm_mask mask;
 *     pm_box *boxes;
 *     const pm_pair *pairs;
 *     size_t count;
 *
 *     pm_session_connect(NULL, &session);
 *     pm_session_frame(session, 3, &frame, &boxes);     shared memory where a daemon serves
 *     ... write boxes[0] to boxes[2] ...
 *     pm_frame_submit(frame, NULL, &pending);
 *     pm_pending_wait(pending, &mask);
 *     pm_mask_pairs(mask, &pairs, &count);
 *     pm_mask_drop(mask);
 *     pm_session_drop(session);
 *
 * Codes. Nearly every function returns a pm_code: PM_OK, or why it did nothing. pm_last_error() names it and says it
 * in words. Results are written through pointers, and only where PM_OK is returned.
 *
 * Handles are values: copy them, compare their ids, store them. Zero is null, and may be dropped. A handle of a
 * dropped object names nothing: PM_ERR_HANDLE.
 *
 * Threads. A session, and what comes of it, belongs to one thread at a time; sessions are independent of each
 * other. A handle that two calls use at once is PM_ERR_BUSY for one of them. A frame may be awaited on another
 * thread than the one that sends it.
 *
 * Pointers. Where a pointer is given, it is null or aligned, and valid for as many values as are said beside it,
 * which nobody else writes during the call. It may be null where there are no values, where a text is left out, and
 * where a function says so. Pointers that are handed out live as long as the function says.
 *
 * Structs that may grow begin with struct_size: set it to sizeof, and all else to zero.
 *
 * Processes. A handle does not survive fork(): connect after it.
 *
 * A test holds this file to the sources in Rust. Licence: MIT OR Apache-2.0. */

#ifndef PAIRMASK_H
#define PAIRMASK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Codes and versions

// What a function returns. Numbers do not change; later versions may add some.
typedef enum {
  PM_OK = 0, // Done.
  // An argument is wrong: a null pointer, a number that stands for nothing, a text that is no UTF-8.
  PM_ERR_ARGUMENT = 1,
  PM_ERR_HANDLE = 2, // The handle is zero, was dropped, or is of another kind.
  PM_ERR_BUSY = 3, // Another call uses the handle: of another thread, or the one whose callback this is.
  PM_ERR_STATE = 4, // The object cannot do that: boxes for spheres, a lease in a scene of one process, no answer yet.
  PM_ERR_PANIC = 5, // A bug of this library. The objects of the call cannot be used any more.
  PM_ERR_TOO_MANY_HANDLES = 6, // More live handles than there are ids.

  PM_ERR_NO_DAEMON = 10, // No daemon serves the instance.
  PM_ERR_NOT_BUILT_IN = 11, // This library was built without the transport.
  PM_ERR_SILENT = 12, // The daemon lives and did not answer in time.
  PM_ERR_OTHER_USER = 13, // The instance is another user's.
  PM_ERR_VERSION_MISMATCH = 14, // The daemon speaks another major version of the wire contract.
  PM_ERR_TOO_MANY_CLIENTS = 15, // The daemon has no slot for another client.
  PM_ERR_OUT_OF_SHARED_MEMORY = 16, // No shared memory is left.
  PM_ERR_ISA = 17, // The instruction set is unknown, or this machine does not have it.
  PM_ERR_INSTANCE = 18, // No name of an instance, or its directory cannot be used.
  PM_ERR_TRANSPORT = 19, // The transport failed.

  PM_ERR_TOO_MANY_BOXES = 30, // More boxes or spheres than an index can name.
  PM_ERR_TOO_MANY_LISTED_PAIRS = 32, // The lists of a frame's rules are too long to be sent.
  PM_ERR_FIRST_SET = 33, // The first of two sets has more boxes than the frame.
  PM_ERR_TOO_MANY_FRAMES = 34, // Three frames are being filled, under way or held as masks.
  PM_ERR_CULL = 35, // The engine failed, or the one asked for is not here.

  PM_ERR_TIMEOUT = 50, // No answer yet. What was waited for is still under way.
  PM_ERR_DAEMON_DIED = 51, // The daemon died before it answered.
  PM_ERR_REPLY = 52, // The daemon answered with an error, or with something that is malformed.
  PM_ERR_ALREADY_RECEIVED = 53, // The answer was received before.

  PM_ERR_BEYOND_LIMIT = 70, // An index beyond what the scene may hold.
  PM_ERR_LENGTHS = 71, // Not one box, or filter data, for each index.
  PM_ERR_MARGINS = 72, // Not one margin for each box, nor one for all; or one is negative or not finite.
  PM_ERR_SET_TWICE = 73, // An index is set twice in one edit.
  PM_ERR_ABSENT = 74, // An index has no box.
  PM_ERR_NO_MARGINS = 75, // A box with a margin in a scene whose boxes have none.
  PM_ERR_OUT_OF_MEMORY = 76, // No memory of this process is left.
  PM_ERR_TOO_MANY_QUERIES = 77, // More queries and indices than a mask has objects.
  PM_ERR_QUERY_FILTER_DATA = 78, // Not filter data for each query, nor one for all.
  PM_ERR_TOO_MANY_FILTERS = 79, // More than 65,536 filters.
  PM_ERR_BOUNDS = 80, // Bounds that are empty or not finite.
  PM_ERR_INEXACT_SHIFT = 81, // A scene is to be moved to where float does not hold its boxes.
  PM_ERR_SCENE_FILE = 82, // A file of a scene cannot be written or read, or is none of this version.
  PM_ERR_SNAPSHOT = 83, // The scene has no such snapshot, or is shared and has none.

  PM_ERR_SCENE_NAME = 90, // No name of a shared scene.
  PM_ERR_IN_PROCESS = 91, // The session answers in process, where there is no shared scene.
  PM_ERR_TERMS_DIFFER = 93, // The shared scene has other terms.
  PM_ERR_LEASE = 94, // The lease is refused.
  PM_ERR_NOT_LEASED = 95, // The edit names what is not leased.

  PM_ERR_OTHER = 99, // An error of a later version of the library's parts, which has no code here.
} pm_code;

// The version of the header: `PM_VERSION == pm_version()` where the program was compiled with the header
// of the library that it has loaded. Major, minor and patch, 8 bits each from bit 16 down.
#define PM_VERSION 256

// How grave a line of the log is: one of `PM_LOG_...`.
typedef uint32_t pm_log_level;
#define PM_LOG_ERROR 1 // Something failed.
#define PM_LOG_WARNING 2 // Something is not as it was meant: this process answers, where no daemon does.
#define PM_LOG_INFO 3 // Something of note happened.

// Called with a line of the log, from any thread, several at once too. It may not throw, nor keep the text.
typedef void (*pm_log)(void *user, pm_log_level level, const char *text);

// Handles: an id, which is zero for none

// A client's connection to a daemon or to the engines of this process.
typedef struct { uint64_t id; } pm_session;

// Memory for the boxes or spheres of one frame: shared memory where a daemon serves. Its contents are
// unspecified: write every box. A daemon has three frames of a session at a time, in any mix of being
// filled, under way and held as masks.
typedef struct { uint64_t id; } pm_frame;

// A frame under way.
typedef struct { uint64_t id; } pm_pending;

// The overlapping pairs of a frame. It holds one of its session's three slots until it is dropped.
typedef struct { uint64_t id; } pm_mask;

// Which boxes of a frame may be a pair at all. It does not change: a daemon gets it once for all frames.
typedef struct { uint64_t id; } pm_rules;

// A persistent scene: edits go in, changes of pairs come out. It lives on without its session.
typedef struct { uint64_t id; } pm_scene;

// Plain values

// A closed box. `min > max` on some axis makes it empty, a NaN invalid; neither overlaps anything.
// Infinities are coordinates. Touching counts.
typedef struct {
  float min[3]; // The smallest corner.
  float max[3]; // The largest corner.
} pm_box;

// A closed ball. A radius below zero disables it.
typedef struct {
  float center[3];
  float radius;
} pm_sphere;

// Two indices, the smaller one first.
typedef struct {
  uint32_t a;
  uint32_t b;
} pm_pair;

// A ray or a segment, thin or as thick as a box that is swept along it. It hits a box if a point origin + t * direction
// with 0 <= t <= most lies in the box, whose faces were moved outward by the half extents. One with a number that is not
// finite hits nothing, but `most` may be infinite; and so does one with a negative half extent or `most`.
typedef struct {
  float origin[3];
  float direction[3]; // Need not be of length 1.
  float most; // The largest t: INFINITY for a ray without an end.
  float half_extents[3]; // 0 for a thin ray.
} pm_ray;

// A box that a ray has hit, or that is near a point.
typedef struct {
  uint32_t query; // The ray or the sphere.
  uint32_t index; // The box; PM_ANY_BOX where only whether there is one was asked.
  float distance; // Along a ray in lengths of its direction; from a sphere's center in units.
} pm_hit;

// Translation, rotation and scale of an object.
typedef struct {
  float translation[3]; // Where the object's origin lies.
  float rotation[4]; // A quaternion x, y, z, w; w is the real part.
  float scale[3]; // Scale on the object's own axes.
} pm_placement;

// Indices from `first` to before `first + count`.
typedef struct {
  uint32_t first;
  uint32_t count;
} pm_range;

#define PM_ALL_WORLDS -1 // A world that meets all others.

// Filter data of a box. A box without any has zeros: world 0, no owner, the first filter.
typedef struct {
  int32_t world; // Boxes of different worlds never meet; `PM_ALL_WORLDS` meets all.
  uint32_t owner; // Boxes of one owner never meet, unless it is 0.
  uint16_t filter; // Index in the table of filters.
  // 1 for a box that is static, regardless of its filter; else 0. Boxes of a scene have `pm_scene_make_static`.
  uint16_t is_static;
} pm_filter_data;

// What boxes of a kind meet. Two static boxes never meet; equal groups other than 0 decide by their sign;
// else `(a.category & b.mask) != 0 && (b.category & a.mask) != 0`, with `||` where both have `either`.
// With all bits of both masks, `{UINT64_MAX, UINT64_MAX, 0, 0, 0}`, it meets everything.
typedef struct {
  uint64_t category; // What it is: a bit a category.
  uint64_t mask; // What it meets: a bit a category.
  int32_t group; // Equal groups: positive, they meet; negative, they do not.
  uint16_t is_static; // 1 for a kind that is static; else 0.
  uint16_t either; // 1 where one mask of two is enough; else 0.
} pm_filter;

typedef char pm_name[24]; // A name in a struct: a text that ends with a zero.

// Sessions

// Where pairs are found: one of `PM_BACKEND_...`. The pairs are the same.
typedef uint32_t pm_backend;
#define PM_BACKEND_AUTO 0 // The daemon while one answers, else in process.
#define PM_BACKEND_DAEMON 1 // The daemon, or an error.
#define PM_BACKEND_IN_PROCESS 2 // The CPU engines of this library.

// What answered: one of `PM_SERVED_BY_...`.
typedef uint32_t pm_served_by;
#define PM_SERVED_BY_DAEMON 1 // The daemon, through shared memory.
#define PM_SERVED_BY_THIS_PROCESS 2 // This process.

// Settings of a session. Zeros mean that the library chooses. Texts are read by `pm_session_connect` alone.
typedef struct {
  size_t struct_size;
  const char *instance; // Name of the daemon's instance; null for `default`.
  const char *runtime_dir; // Directory of instances; null for `$PAIRMASK_RUNTIME_DIR`, or its default.
  const char *engine; // Forced engine, by a name that `pairmaskd cull --help` lists; null for the plan's.
  const char *encoding; // Forced encoding: `dense`, `sparse` or `list`; null for the plan's choice.
  const char *isa; // Instruction set of engines and decoders here; null for `$PAIRMASK_ISA`, else the widest.
  pm_backend backend;
  uint32_t threads; // Threads that an engine may use.
  uint32_t iterate_threads; // Threads that iterate over pairs.
  uint32_t capacity; // Boxes that the first segment should hold.
  uint64_t spin_ns; // Time to spin for an answer beyond its expected time, ns; `UINT64_MAX` for none.
  uint64_t deadline_ns; // How long a wait waits, ns; 5 s unless set.
  uint32_t no_repeats; // 1 where a frame that is equal to the last one is culled anew: for measurements.
} pm_session_options;

// The status of a daemon.
typedef struct {
  size_t struct_size;
  uint32_t pid; // Id of its process.
  uint32_t client_count; // Clients that are connected.
  uint64_t uptime_ns; // Nanoseconds since it began to serve.
  uint64_t frames; // Frames answered.
  uint64_t boxes; // Boxes in those frames.
  uint64_t pairs; // Pairs in those frames.
  uint64_t spheres; // Spheres in those frames.
  uint64_t errors; // Requests answered with an error.
  uint32_t scenes; // Scenes that it has.
  uint32_t scene_mib; // Memory of those, MiB.
} pm_daemon_status;

// Frames

// The form in which boxes are sent: one of `PM_FORM_...`.
typedef uint32_t pm_form;
#define PM_FORM_F32 0 // 24 bytes a box, exact.
#define PM_FORM_Q16 1 // 12 bytes a box, in steps of the bounds' extent / 65,534.
#define PM_FORM_Q8 2 // 6 bytes a box, in steps of the bounds' extent / 254.
#define PM_FORM_F16 3 // 12 bytes a box, half floats.

// How boxes are sent that may add pairs, and miss none.
typedef struct {
  pm_form form;
  pm_box bounds; // Bounds of the world, for `PM_FORM_Q16` and `PM_FORM_Q8`.
} pm_precision;

// What rules are made of, and in which order they decide: boxes of different worlds never meet; an included
// pair is reported where it overlaps; boxes of one owner never meet; two static ones never; an excluded pair
// never; then filters decide. All arrays are copied.
typedef struct {
  size_t struct_size;
  const pm_filter_data *filter_data; // By index. An index beyond them has filter data of zeros.
  size_t filter_data_count;
  const pm_filter *filters; // What filter data names. One beyond them meets everything.
  size_t filter_count; // At most 65,536.
  const pm_pair *included; // Pairs that are reported, even if anything but worlds keeps them apart.
  size_t included_count;
  const pm_pair *excluded; // Pairs that are never reported.
  size_t excluded_count;
} pm_rules_desc;

// What is asked of a frame beside its pairs.
typedef struct {
  size_t struct_size;
  pm_rules filters; // Collision filters, with filter data for each box or with none; zero for none.
  uint32_t two_sets; // Not 0: only pairs of one of the first `split_at` boxes and one of the others count.
  uint32_t split_at; // Boxes of the first set.
} pm_frame_options;

// How a mask is written: one of `PM_ENCODING_...`.
typedef uint32_t pm_encoding;
#define PM_ENCODING_DENSE 0 // A bit for every pair of boxes.
#define PM_ENCODING_SPARSE 1 // The words that are not zero, and where they belong.
#define PM_ENCODING_LIST 2 // The pairs.

// Facts about an answered frame beside its pairs.
typedef struct {
  size_t struct_size;
  pm_served_by served_by;
  pm_encoding encoding;
  uint32_t n; // Boxes or spheres of the frame.
  uint32_t threads; // Threads that the engine could use.
  uint32_t empty; // Boxes with `min > max` on some axis.
  uint32_t invalid; // Boxes with a NaN.
  uint32_t is_repeat; // 1 where the frame was equal to the last one, so that no engine ran; else 0.
  uint64_t pair_count; // Pairs that overlap.
  uint64_t skipped_pairs; // Pairs that were never compared, of n(n - 1)/2.
  uint64_t mask_bytes; // Bytes of the mask.
  uint64_t box_bytes; // Bytes of the boxes or spheres as they were sent.
  uint64_t total_ns; // Time from the request in hand to the answer ready to be sent, ns.
  uint64_t execute_ns; // Of that: the pairs tested.
  pm_name engine; // Name of the engine.
  // The box index at each position of a sparse mask, as an array that lives until the mask is dropped. Null
  // where a position is an index: every mask that is not sparse, and some that are.
  const uint32_t *order;
  size_t order_count;
} pm_frame_info;

// A word of a mask that is not zero. Bit t of `bits`, where it is set, names a pair: in a dense mask, pair
// `first + t` in the order (0, 1), (0, 2), (0, 3) and so on, row by row: of n boxes, a < b is pair
// a(2n - a - 1)/2 + b - a - 1. In a sparse mask, positions `row` and `32 * block + t` of the frame's
// `order`; in a list, boxes `row` and `32 * block + t`.
typedef struct {
  uint64_t first; // Of a dense mask: number of the first pair.
  uint32_t row; // Of a sparse mask: position of the row. Of a list: the lower index.
  uint32_t block; // Of a sparse mask or a list: block of 32 columns.
  uint32_t bits; // A bit a pair.
} pm_word;

// Called with some pairs at a time. It may not throw, nor keep the pairs, nor use the handle of the call.
typedef void (*pm_pair_callback)(void *user, const pm_pair *pairs, size_t count);

// Called with some words of a mask at a time, as `pm_pair_callback` with pairs.
typedef void (*pm_word_callback)(void *user, const pm_word *words, size_t count);

// Scenes

// Whether a scene's boxes have margins, and which pairs it reports: one of `PM_MARGINS_...`.
typedef uint32_t pm_margins;
#define PM_MARGINS_NONE 0 // Boxes have no margins.
#define PM_MARGINS_EXACT 1 // Answers are those of the boxes as they were set.
#define PM_MARGINS_NEAR 2 // Answers are those of the inflated boxes, near pairs too.

// Settings of a scene. Zeros mean that the library chooses.
typedef struct {
  size_t struct_size;
  uint32_t most_boxes; // Indices are below this. At most 2^29; 2^24 unless set.
  uint32_t threads; // Threads of this process that the scene may use.
  pm_margins margins; // With margins, a box is sent only when it has left its own.
  float usual_margin; // The margin of boxes that are set without one.
} pm_scene_options;

// What becomes of a dead writer's boxes: one of `PM_AT_END_...`.
typedef uint32_t pm_at_end;
#define PM_AT_END_ANY 0 // As the other members choose; removed where none does.
#define PM_AT_END_REMOVE 1 // They are removed.
#define PM_AT_END_KEEP 2 // They survive until the next lease of their indices.

// Settings of a member of a shared scene. Zeros leave them to the first member, or to the daemon.
typedef struct {
  size_t struct_size;
  uint64_t tick_deadline_ns; // Longest time of a tick from its first commit, ns; else 100 ms; at most 10 s.
  uint32_t most_boxes; // Indices are below this.
  pm_at_end at_end;
  uint32_t all_pairs; // 1 for a member to which all pairs are reported; 0 for those of its own boxes.
  pm_margins margins; // `PM_MARGINS_NEAR` for boxes with margins, or `PM_MARGINS_NONE`.
  float usual_margin; // The margin of boxes that are set without one.
} pm_join_options;

// What indices are: one of `PM_INDICES_...`.
typedef uint32_t pm_indices_kind;
#define PM_INDICES_RANGE 0 // From `first` to before `first + count`.
#define PM_INDICES_LIST 1 // The `count` values, in any order.
#define PM_INDICES_MASK 2 // The bits of `count` values: bit t of value w is index `first + 32 w + t`.

// Indices of boxes. One index is a range: `{.first = 7, .count = 1}`.
typedef struct {
  pm_indices_kind kind;
  uint32_t first; // Of a range or a mask: the first one.
  size_t count; // How many indices, or values.
  const uint32_t *values; // Of a list or a mask.
} pm_indices;

// What an edit reports: one of `PM_REPORT_...`.
typedef uint32_t pm_report;
#define PM_REPORT_CHANGES 0 // Pairs that began and ended since the last answer that was waited for.
#define PM_REPORT_MOVED 1 // Pairs of now with a box that the edit set, enabled, disabled or flagged.
#define PM_REPORT_ALL 2 // All pairs of now.
#define PM_REPORT_NOTHING 3 // Nothing: the edit is applied.

// Which boxes a cast reports of each ray or sphere: one of `PM_HITS_...`.
typedef uint32_t pm_hits;
#define PM_HITS_ALL 1 // All.
#define PM_HITS_CLOSEST 2 // So many of the closest.
#define PM_HITS_ANY 3 // Whether there is one: a hit of `PM_ANY_BOX`, or none.

#define PM_ANY_BOX UINT32_MAX // The index of a hit that stands for any box.

// Why a pair ended: one of `PM_ENDED_...`.
typedef uint32_t pm_end_reason;
#define PM_ENDED_REMOVED 0 // A box of the pair was removed, also where its index has a new box.
#define PM_ENDED_FILTERED 1 // A box is disabled now, both are static now, or rules keep them apart.
#define PM_ENDED_SEPARATED 2 // The boxes overlap no more.

// A pair that ended.
typedef struct {
  uint32_t a; // The smaller index.
  uint32_t b; // The larger index.
  pm_end_reason reason;
} pm_ended;

// The answer to an edit. It and its arrays live until the next call that writes or sends an edit, queries the
// scene, makes it resync, leases, or gives back.
typedef struct {
  size_t struct_size;
  // 1 where changes were requested and `pairs` has all pairs instead: discard those that you have. Else 0.
  uint32_t is_resync;
  pm_served_by served_by;
  const pm_pair *begun; // Pairs that began, for `PM_REPORT_CHANGES`.
  size_t begun_count;
  const pm_ended *ended; // Pairs that ended, for `PM_REPORT_CHANGES`.
  size_t ended_count;
  const pm_pair *pairs; // Pairs of now, for `PM_REPORT_ALL`, `PM_REPORT_MOVED` and a resync.
  size_t pair_count;
  const pm_range *late; // Of a shared scene: leases of writers that had not committed when the tick ended.
  size_t late_count;
  uint64_t all_pairs; // Pairs of the whole scene; `UINT64_MAX` where it is not known.
  uint64_t skipped_pairs; // Pairs that were not tested.
  uint64_t tick; // Of a shared scene: the tick, from 1.
  pm_name engine; // Name of the engine.
} pm_answer;

// Facts about a scene.
typedef struct {
  size_t struct_size;
  uint64_t boxes; // Boxes, disabled ones too; of a shared scene, this member's.
  uint64_t allocated_bytes; // Bytes of it in this process.
  uint64_t daemon_bytes; // Bytes of it in the daemon, by its last answer; 0 of none, and of a shared scene.
  uint64_t edits; // Of a scene with margins: edits that were applied.
  uint64_t requests; // Of those: edits for which a request was made.
  uint64_t set; // Boxes that edits set.
  uint64_t sent; // Of those: boxes that were sent.
  uint64_t most_boxes; // Indices are below this.
  uint64_t tick_deadline_ns; // Of a shared scene: longest time of a tick from its first commit, ns; else 0.
  const pm_range *leases; // Of a shared scene: this member's, until `pm_scene_get_info` is called again.
  size_t lease_count;
} pm_scene_info;

#ifdef __cplusplus
extern "C" {
#endif

// What was wrong with the last call of this thread that failed: the name of its code, and words; empty where
// none did. The text lives until another call of this thread fails.
const char *pm_last_error(void);

// The version of the library that was loaded, as `PM_VERSION` writes it. Before 1.0, a program works with
// libraries of its minor version; from then on, with those of its major version that are not older.
uint32_t pm_version(void);

// Hands the library's log to the program. It can be set once: `PM_ERR_STATE` after that.
pm_code pm_set_log(pm_log log, void *user);

// Drop an object. What came of a session lives on, and rules in submitted frames; a frame is not submitted; the
// answer to a pending one is discarded; decoded pairs are dropped with their mask; a shared scene is left.
pm_code pm_session_drop(pm_session session);
pm_code pm_frame_drop(pm_frame frame);
pm_code pm_pending_drop(pm_pending pending);
pm_code pm_mask_drop(pm_mask mask);
pm_code pm_rules_drop(pm_rules rules);
pm_code pm_scene_drop(pm_scene scene);

// Sessions

// Makes a session. `options` may be null. With `PM_BACKEND_AUTO` a missing daemon is no error.
pm_code pm_session_connect(const pm_session_options *options, pm_session *session);

// What would serve the next frame by the present state.
pm_code pm_session_served_by(pm_session session, pm_served_by *served_by);

// Asks the daemon for its status. Set `status->struct_size` first.
pm_code pm_session_daemon_status(pm_session session, pm_daemon_status *status);

// Copies boxes, sends them and waits: the shortest way from boxes to pairs. `filters` may be zero. Where
// frames and masks hold all of the session's slots at a daemon, it waits for one, as long as the session's
// deadline allows.
pm_code pm_session_cull(pm_session session, const pm_box *boxes, size_t n, pm_rules filters, pm_mask *mask);

// Frames that are filled

// Begins a frame of `n` boxes. `boxes`, which may be null, is set to their memory, which is the caller's to
// write until the frame is submitted or dropped.
pm_code pm_session_frame(pm_session session, size_t n, pm_frame *frame, pm_box **boxes);

// Begins a frame of `n` spheres. `spheres`, which may be null, is set to their memory.
pm_code pm_session_sphere_frame(pm_session session, size_t n, pm_frame *frame, pm_sphere **spheres);

// Begins a frame of `n` boxes that are sent with less precision: `pm_frame_write` and its like write them.
pm_code pm_session_narrow_frame(pm_session session, size_t n, const pm_precision *precision,
                                pm_frame *frame);

// Copies all boxes of a frame from an array. Large frames are copied by several threads.
pm_code pm_frame_write(pm_frame frame, const pm_box *boxes, size_t n);

// Writes all boxes of a frame from their smallest and largest corners, three floats each.
pm_code pm_frame_write_corners(pm_frame frame, const float *min, const float *max, size_t n);

// Writes all boxes of a frame from their centres and half extents, three floats each.
pm_code pm_frame_write_centers(pm_frame frame, const float *center, const float *half, size_t n);

// Writes all boxes of a frame as what boxes in their objects' own coordinates cover once the objects are
// placed. They are rounded outward: no pair is lost.
pm_code pm_frame_write_placed(pm_frame frame, const pm_box *locals, const pm_placement *placements,
                              size_t n);

// Writes one box of a frame.
pm_code pm_frame_set(pm_frame frame, uint32_t index, const pm_box *b);

// Sends a frame. `options` may be null. Its handle and its memory are invalid then, regardless of what is returned.
pm_code pm_frame_submit(pm_frame frame, const pm_frame_options *options, pm_pending *pending);

// Frames under way

// Waits for the pairs, as long as the session's deadline allows. The handle names nothing any more, regardless of
// what is returned. With `PM_BACKEND_AUTO` no failure of the daemon is an error: this process answers then.
pm_code pm_pending_wait(pm_pending pending, pm_mask *mask);

// Waits for the pairs, at most so many nanoseconds; with 0 it polls. After `PM_ERR_TIMEOUT`, `PM_ERR_ARGUMENT`
// and `PM_ERR_BUSY` the frame is still under way; else the handle names nothing any more.
pm_code pm_pending_wait_timeout(pm_pending pending, uint64_t timeout_ns, pm_mask *mask);

// Masks

// Whether two boxes are a pair.
pm_code pm_mask_contains(pm_mask mask, uint32_t a, uint32_t b, bool *contains);

// All pairs as an array, which lives until the mask is dropped. A list in this process's memory is given
// where it lies; else the pairs are decoded once, into memory that later masks of the thread use again.
pm_code pm_mask_pairs(pm_mask mask, const pm_pair **pairs, size_t *count);

// The pairs of one world, as an array that lives until the mask is dropped; none where the world has none.
// Only masks of frames whose rules have worlds know them; `PM_ERR_STATE` from others.
pm_code pm_mask_pairs_of_world(pm_mask mask, int32_t world, const pm_pair **pairs, size_t *count);

// Calls `callback` with all pairs, some at a time: the fastest way through a mask, without a copy of it.
pm_code pm_mask_for_each(pm_mask mask, pm_pair_callback callback, void *user);

// Calls `callback` with the words of a mask that are not zero, some at a time: for AND masks of the caller's
// own. Each pair of a list is a word of one bit.
pm_code pm_mask_for_each_word(pm_mask mask, pm_word_callback callback, void *user);

// Facts about the frame beside its pairs. Set `info->struct_size` first.
pm_code pm_mask_info(pm_mask mask, pm_frame_info *info);

// Rules and filters

// Makes rules.
pm_code pm_rules_create(const pm_rules_desc *desc, pm_rules *rules);

// Rapier's `collision_groups`: memberships, filter, and whether the test mode is Or. `is_dynamic` is false
// for fixed and kinematic bodies, here and below.
pm_filter pm_filter_from_rapier(uint32_t memberships, uint32_t filter, bool is_or, bool is_dynamic);
// Box2D's and Box3D's `b2Filter`.
pm_filter pm_filter_from_box2d(uint64_t category, uint64_t mask, int32_t group, bool is_dynamic);
// Bullet's `m_collisionFilterGroup` and `m_collisionFilterMask`.
pm_filter pm_filter_from_bullet(int32_t group, int32_t mask);
// Jolt's `ObjectLayerPairFilterMask`.
pm_filter pm_filter_from_jolt_mask(uint32_t group, uint32_t mask, bool is_dynamic);
// `word0` (what a shape is) and `word1` (what it meets) of a `PxFilterData` for the shader of PhysX's snippets.
pm_filter pm_filter_from_physx_words(uint32_t word0, uint32_t word1, bool is_dynamic);
// Newton's `shape_collision_group`.
pm_filter pm_filter_from_newton(int32_t group, bool collides);
// MuJoCo's `contype` and `conaffinity`.
pm_filter pm_filter_from_mujoco(int32_t contype, int32_t conaffinity);

// Boxes

// The f32 box around a box in f64, three numbers a corner, relative to `origin`, rounded outward: no pair is
// lost where all boxes of a frame have one origin.
pm_code pm_box_outward(const double *min, const double *max, const double *origin, pm_box *b);

// What a box touches on its way from one place to another.
pm_box pm_box_swept(pm_box from, pm_box to);

// Scenes: the edit that is written

// Makes a scene, in the daemon where the session has one, else in this process. `options` may be null.
pm_code pm_scene_create(pm_session session, const pm_scene_options *options, pm_scene *scene);

// Sets the box of an index; inserts it where there is none. Box and margin are copied. `margin` may be null:
// in a scene with margins the box has the usual one then. A scene without margins knows that of 0 alone.
pm_code pm_scene_set(pm_scene scene, uint32_t index, const pm_box *b, const float *margin);

// Sets boxes: one for each index. They are read where they lie, until the edit is answered. `margins`, which
// are copied, are none, one for all boxes, or one for each.
pm_code pm_scene_set_all(pm_scene scene, pm_indices indices, const pm_box *boxes, size_t n,
                         const float *margins, size_t margin_count);

// Removes boxes.
pm_code pm_scene_remove(pm_scene scene, pm_indices indices);

// Disables boxes (they overlap nothing) with `on` false, else enables them.
pm_code pm_scene_set_enabled(pm_scene scene, pm_indices indices, bool on);

// Makes boxes static (two static boxes are no pair) or not.
pm_code pm_scene_make_static(pm_scene scene, pm_indices indices, bool is_static);

// Gives boxes their filter data: one for each index. A box that is inserted has filter data of zeros. `is_static` of
// filter data has no effect: see `pm_scene_make_static`. The arrays are read where they lie, until the edit is
// answered.
pm_code pm_scene_set_filter(pm_scene scene, pm_indices indices, const pm_filter_data *filter_data, size_t n);

// Gives boxes user data, one for each index: numbers of the program's own, which change nothing that is reported. A box
// that is inserted has 0. The arrays are read where they lie, until the edit is answered.
pm_code pm_scene_set_user_data(pm_scene scene, pm_indices indices, const uint64_t *user_data, size_t n);

// The filters that filter data names, in place of all before. They are copied.
pm_code pm_scene_filter_table(pm_scene scene, const pm_filter *filters, size_t n);

// Adds pairs of indices to the include list, or removes them from it. The array is read where it lies, until
// the edit is answered.
pm_code pm_scene_include(pm_scene scene, const pm_pair *pairs, size_t n, bool on);

// Adds pairs of indices to the exclude list, or removes them from it, as `pm_scene_include` does.
pm_code pm_scene_exclude(pm_scene scene, const pm_pair *pairs, size_t n, bool on);

// Discards the edit that is being written.
pm_code pm_scene_discard(pm_scene scene);

// Scenes: answers

// Sends the edit that was written: removals first, then boxes that are set, then enabled and static flags
// in their order, then what is about rules. A daemon works on it while this thread does something else.
// Regardless of what is returned, the edit is written no more.
pm_code pm_scene_submit(pm_scene scene, pm_report report);

// Waits for the answer to what was submitted, as long as the session's deadline allows, and for a shared
// scene until its tick ends. That acknowledges it: what it reports is not reported again. `answer` may be
// null; set `answer->struct_size` first. Where the answer was waited for before, it is given again. After an
// error of the wait the edit is applied, and the next answer makes up for this one.
pm_code pm_scene_wait(pm_scene scene, pm_answer *answer);

// `pm_scene_submit` and `pm_scene_wait`.
pm_code pm_scene_commit(pm_scene scene, pm_report report, pm_answer *answer);

// Requests a resync: the next changes are one. The scene's answer ends.
pm_code pm_scene_resync(pm_scene scene);

// The box of an index, also of a disabled one; `PM_ERR_ABSENT` where there is none. The scene's answer stays;
// an edit under way is not waited for any more.
pm_code pm_scene_get(pm_scene scene, uint32_t index, pm_box *b);

// The user data of indices, such as both of each pair of a list: `user_data` is set to as many numbers, as an array that
// lives until the scene is asked for user data again, or dropped. That of a removed box stays until another has its index, or
// the scene goes back to a snapshot: so pairs that ended have theirs. Of a shared scene, that of other members' boxes is known
// as of the last answer. The scene's answer stays.
pm_code pm_scene_get_user_data(pm_scene scene, const uint32_t *indices, size_t n, const uint64_t **user_data);

// Facts about a scene, whose answer stays as with `pm_scene_get`. Set `info->struct_size` first.
pm_code pm_scene_get_info(pm_scene scene, pm_scene_info *info);

// Saves a scene in a file: boxes, flags, filters and pair lists, of a shared one this member's. What was reported is not
// saved. An edit that is being written is discarded, and the scene's answer ends.
pm_code pm_scene_save(pm_scene scene, const char *path);

// A scene of a file that pm_scene_save has written, of this version or another of the same major one. Its boxes begin with
// the next changes. `options` may be null.
pm_code pm_session_load_scene(pm_session session, const pm_scene_options *options, const char *path,
                              pm_scene *scene);

// Moves all boxes of a scene by a vector of three numbers, of a shared one this member's. No pair begins or ends: where float does not hold
// every coordinate afterwards, PM_ERR_INEXACT_SHIFT, and the scene is what it was. An edit that is being written is
// discarded, and the scene's answer ends.
pm_code pm_scene_shift_origin(pm_scene scene, const float *by);

// Takes a snapshot of a scene: boxes, flags, filters, pair lists and what was reported. `snapshot` is set to its number,
// which is not 0. From then on each edit copies what it changes, once a snapshot, until that is forgotten or the scene
// dropped. Where changes are yet to be reported when the only snapshot is taken, the next changes are a resync. A shared
// scene has none: PM_ERR_SNAPSHOT. For this and the next two calls, an edit that is being written is discarded, and the
// scene's answer ends.
pm_code pm_scene_take_snapshot(pm_scene scene, uint64_t *snapshot);

// Goes back to a snapshot, or forward to a later one: the same edits have the same answers again, to the byte. No pair is
// reported for this; the program goes back too. All snapshots are kept. PM_ERR_SNAPSHOT, where there is none of this
// number.
pm_code pm_scene_restore(pm_scene scene, uint64_t snapshot);

// Forgets a snapshot. PM_ERR_SNAPSHOT, where there is none of this number.
pm_code pm_scene_forget_snapshot(pm_scene scene, uint64_t snapshot);

// Asks which boxes of a scene some other boxes overlap. `filter_data` is null, so that boxes of all worlds are found,
// or one for all queries, or one for each: then only what may meet such filter data is found. `found` is set to pairs
// of a query's number and an index, by query and then by index, as an array that lives until the scene is queried
// again, or dropped. The scene's answer ends. A shared scene is asked as the last tick made it.
pm_code pm_scene_query(pm_scene scene, const pm_box *boxes, size_t n, const pm_filter_data *filter_data,
                       size_t filter_data_count, const pm_pair **found, size_t *count);

// Asks which boxes of a scene rays hit: all, or at most `most` of the closest of each ray, or whether there is one, as
// `hits` says; `most` is for PM_HITS_CLOSEST alone. Filter data are those of a query. `found` is set to hits, by ray, by
// distance, and then by index, as an array that lives until the scene is asked for hits again, or dropped. The scene's
// answer ends.
pm_code pm_scene_cast(pm_scene scene, const pm_ray *rays, size_t n, pm_hits hits, uint32_t most,
                      const pm_filter_data *filter_data, size_t filter_data_count, const pm_hit **found,
                      size_t *count);

// Asks in the same way which boxes of a scene spheres touch, the nearest to each center first. With PM_HITS_CLOSEST and
// an infinite radius, these are so many nearest boxes of a point.
pm_code pm_scene_nearest(pm_scene scene, const pm_sphere *spheres, size_t n, pm_hits hits, uint32_t most,
                         const pm_filter_data *filter_data, size_t filter_data_count, const pm_hit **found,
                         size_t *count);

// Scenes that several processes write

// Joins a scene that several processes write, by its name: 1 to 64 letters, digits and `-_.:/`. It needs a
// daemon. `options` may be null.
pm_code pm_scene_join(pm_session session, const char *name, const pm_join_options *options,
                      pm_scene *scene);

// Leases a range of indices: this member alone may set boxes there.
pm_code pm_scene_lease(pm_scene scene, pm_range range);

// Leases the lowest free range of so many indices. Which one that is depends on the members' order.
pm_code pm_scene_lease_any(pm_scene scene, uint32_t count, pm_range *range);

// Gives back the lease that begins at an index. Its boxes are removed.
pm_code pm_scene_give_back(pm_scene scene, uint32_t first);

#ifdef __cplusplus
}
#endif

#endif
