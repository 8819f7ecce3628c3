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
 * Codes. Nearly every function returns a pm_code: PM_OK, or why it did nothing. pm_last_error() says it in words.
 * Results are written through pointers, and only where PM_OK is returned.
 *
 * Handles are values: copy them, compare their ids, keep them. Zero is null. A handle of what was dropped is
 * told from one that lives: PM_ERR_HANDLE. Dropping zero is fine.
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
 * This file is generated: see cbindgen.toml. Licence: MIT OR Apache-2.0. */

#ifndef PAIRMASK_H
#define PAIRMASK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// A world that meets all others.
#define PM_ALL_WORLDS -1

// The version of the header: `PM_VERSION == pm_version()` where the program was compiled with the header of
// the library that it has loaded. Major, minor and patch, 8 bits each from bit 16 down.
#define PM_VERSION 256

// What a function returns: `PM_OK`, or why it did nothing. Numbers do not change; later versions may add
// some.
typedef int32_t pm_code;

// A closed box. `min > max` on some axis makes it empty, a NaN invalid; neither overlaps anything.
// Infinities are coordinates. Touching counts.
typedef struct {
  // The smallest corner.
  float min[3];
  // The largest corner.
  float max[3];
} pm_box;

// What boxes of a kind meet. Two static boxes never meet; equal groups other than 0 decide by their sign; else
// `(a.category & b.mask) != 0 && (b.category & a.mask) != 0`, with `||` where both say `either`.
typedef struct {
  // What it is: a bit a category.
  uint64_t category;
  // What it meets: a bit a category.
  uint64_t mask;
  // Equal groups: positive, they meet; negative, they do not.
  int32_t group;
  // 1 for a kind that is static; else 0.
  uint16_t is_static;
  // 1 where one mask of two is enough; else 0.
  uint16_t either;
} pm_filter;

// A client's connection to a daemon or to the engines of this process.
typedef struct {
  // Zero for none.
  uint64_t id;
} pm_session;

// Memory for the boxes or spheres of one frame: shared memory where a daemon serves. Its contents are
// unspecified: write every box. A daemon has three frames of a session at a time, in any mix of being filled, under
// way and held as masks.
typedef struct {
  // Zero for none.
  uint64_t id;
} pm_frame;

// A closed ball. A radius below zero switches it off.
typedef struct {
  // Centre.
  float center[3];
  // Radius.
  float radius;
} pm_sphere;

// The form in which boxes are sent: one of `PM_FORM_...`.
typedef uint32_t pm_form;

// How boxes are sent that may add pairs, and miss none.
typedef struct {
  // `PM_FORM_...`.
  pm_form form;
  // Bounds of the world, for `PM_FORM_Q16` and `PM_FORM_Q8`.
  pm_box bounds;
} pm_precision;

// Translation, rotation and scale of an object.
typedef struct {
  // Where the object's origin lies.
  float translation[3];
  // A quaternion x, y, z, w; w is the real part.
  float rotation[4];
  // Scale on the object's own axes.
  float scale[3];
} pm_placement;

// Which boxes of a frame may be a pair at all. It does not change: a daemon gets it once, however many frames
// have it.
typedef struct {
  // Zero for none.
  uint64_t id;
} pm_rules;

// What is asked of a frame beside its pairs.
typedef struct {
  // `sizeof(pm_frame_options)`.
  size_t struct_size;
  // Collision filters, with a tag for each box or with none; zero for none. A daemon gets them once, however many
  // frames have them.
  pm_rules filters;
  // Not 0: two sets. Only pairs of one of the first `split_at` boxes and one of the others count.
  uint32_t two_sets;
  // Boxes of the first set.
  uint32_t split_at;
} pm_frame_options;

// A frame under way.
typedef struct {
  // Zero for none.
  uint64_t id;
} pm_pending;

// The overlapping pairs of a frame. It holds one of its session's three places until it is dropped.
typedef struct {
  // Zero for none.
  uint64_t id;
} pm_mask;

// How grave a line of the log is: one of `PM_LOG_...`.
typedef uint32_t pm_log_level;

// Called with a line of the log, from any thread, several at once too. The text is the callback's until it
// returns. It may not throw.
typedef void (*pm_log)(void *user,
                       pm_log_level level,
                       const char *text);

// Two indices, the smaller one first.
typedef struct {
  // The smaller index.
  uint32_t a;
  // The larger index.
  uint32_t b;
} pm_pair;

// Called with some pairs at a time. The pairs are the callback's until it returns. It may not throw, nor use
// the handle that it is called for.
typedef void (*pm_visit)(void *user,
                         const pm_pair *pairs,
                         size_t count);

// A word of a mask that is not zero. Bit t of `bits`, where it is set, names a pair: in a dense mask, pair
// `first + t` in the order (0, 1), (0, 2), (0, 3) and so on, row by row: of n boxes, a < b is pair
// a(2n - a - 1)/2 + b - a - 1. In a sparse mask, positions `row` and `32 * block + t` of `pm_mask_order`; in a
// list, boxes `row` and `32 * block + t`.
typedef struct {
  // Of a dense mask: number of the first pair.
  uint64_t first;
  // Of a sparse mask: position of the row. Of a list: the lower index.
  uint32_t row;
  // Of a sparse mask or a list: block of 32 columns.
  uint32_t block;
  // A bit a pair.
  uint32_t bits;
  // Zero.
  uint32_t reserved;
} pm_word;

// Called with some words of a mask at a time.
typedef void (*pm_visit_words)(void *user,
                               const pm_word *words,
                               size_t count);

// What answered: one of `PM_SERVED_BY_...`.
typedef uint32_t pm_served_by;

// How a mask is written: one of `PM_ENCODING_...`.
typedef uint32_t pm_encoding;

// A name in a struct: a text that ends with a zero.
typedef char pm_name[24];

// Facts about an answered frame beside its pairs.
typedef struct {
  // `sizeof(pm_frame_info)`, set by the caller.
  size_t struct_size;
  // What answered.
  pm_served_by served_by;
  // How the mask is written.
  pm_encoding encoding;
  // Boxes or spheres of the frame.
  uint32_t n;
  // Threads that the engine could use.
  uint32_t threads;
  // Boxes with `min > max` on some axis.
  uint32_t empty;
  // Boxes with a NaN.
  uint32_t invalid;
  // 1 where the frame was equal to the last one, so that no engine looked at it; else 0.
  uint32_t is_repeat;
  // Zero.
  uint32_t reserved;
  // Pairs that were never compared, of n(n - 1)/2.
  uint64_t skipped_pairs;
  // Bytes of the mask.
  uint64_t mask_bytes;
  // Bytes of the boxes or spheres as they were sent.
  uint64_t box_bytes;
  // Time from the request in hand to the answer ready to be sent, ns.
  uint64_t total_ns;
  // Of that: the pairs tested.
  uint64_t execute_ns;
  // Name of the engine.
  pm_name engine;
} pm_frame_info;

// The boxes of a scene that some other boxes overlap: pairs of a query's number and an index, by query and then
// by index. An answer of a daemon holds one of the session's three places until it is dropped.
typedef struct {
  // Zero for none.
  uint64_t id;
} pm_found;

// What a box is to the rules. Zeros are what a box has that was given none: world 0, no owner, the first
// filter.
typedef struct {
  // Boxes of different worlds never meet; `PM_ALL_WORLDS` meets all.
  int32_t world;
  // Boxes of one owner never meet, unless it is 0.
  uint32_t owner;
  // Place in the table of filters.
  uint16_t filter;
  // 1 for a box that is static, whatever its filter says; else 0. Of boxes of a scene `pm_scene_make_static` says
  // it instead.
  uint16_t is_static;
} pm_tag;

// What rules are made of. They decide in this order: boxes of different worlds never meet; an included pair is
// reported where it overlaps; boxes of one owner never meet; two static ones never; an excluded pair never; then
// filters decide. All arrays are copied.
typedef struct {
  // `sizeof(pm_rules_desc)`.
  size_t struct_size;
  // Tags by index. An index beyond them has a tag of zeros.
  const pm_tag *tags;
  // How many.
  size_t tag_count;
  // The filters that tags name. One beyond them meets everything.
  const pm_filter *filters;
  // How many; at most 65,536.
  size_t filter_count;
  // Pairs that are reported, whatever else keeps them apart but worlds.
  const pm_pair *included;
  // How many.
  size_t included_count;
  // Pairs that are never reported.
  const pm_pair *excluded;
  // How many.
  size_t excluded_count;
} pm_rules_desc;

// Whether a scene's boxes have margins, and which pairs it tells: one of `PM_MARGINS_...`.
typedef uint32_t pm_margins;

// Settings of a scene. Zeros mean that the library chooses.
typedef struct {
  // `sizeof(pm_scene_options)`.
  size_t struct_size;
  // Indices are below this. At most 2^29; 2^24 unless set.
  uint32_t most_boxes;
  // Threads of this process that the scene may use.
  uint32_t threads;
  // `PM_MARGINS_...`: with margins, a box is sent only when it has left its own.
  pm_margins margins;
  // The margin of boxes that are set without one.
  float usual_margin;
} pm_scene_options;

// A scene that persists: boxes stay from answer to answer, edits go in, changes of pairs come out. It lives on
// without its session.
typedef struct {
  // Zero for none.
  uint64_t id;
} pm_scene;

// Facts about a scene.
typedef struct {
  // `sizeof(pm_scene_info)`, set by the caller.
  size_t struct_size;
  // Boxes, those that are switched off too; of a shared scene, this member's.
  uint64_t boxes;
  // Bytes that this process keeps of the scene.
  uint64_t allocated_bytes;
  // Bytes that the daemon keeps of it, by its last answer; 0 where it has none, and of a shared scene.
  uint64_t daemon_bytes;
  // Of a scene with margins: edits that were applied.
  uint64_t edits;
  // Of those: edits for which a request was made.
  uint64_t requests;
  // Boxes that edits set.
  uint64_t set;
  // Of those: boxes that were sent.
  uint64_t sent;
} pm_scene_info;

// Facts about the answer to an edit.
typedef struct {
  // `sizeof(pm_answer)`, set by the caller.
  size_t struct_size;
  // 1 where changes were asked for and `pm_scene_pairs` has all pairs instead: forget the pairs that you
  // know. Else 0.
  uint32_t is_resync;
  // What answered.
  pm_served_by served_by;
  // Pairs that began.
  uint64_t begun;
  // Pairs that ended.
  uint64_t ended;
  // Pairs that `pm_scene_pairs` has.
  uint64_t pairs;
  // Pairs of the whole scene; `UINT64_MAX` where the answer does not know.
  uint64_t pair_count;
  // Pairs that were not tested.
  uint64_t skipped_pairs;
  // Of a shared scene: the tick, from 1.
  uint64_t tick;
  // Of a shared scene: leases of writers that were late.
  uint64_t late;
  // Name of the engine.
  pm_name engine;
} pm_answer;

// Why a pair ended: one of `PM_ENDED_...`.
typedef uint32_t pm_end_reason;

// A pair that ended.
typedef struct {
  // The smaller index.
  uint32_t a;
  // The larger index.
  uint32_t b;
  // Why.
  pm_end_reason reason;
} pm_ended;

// Indices from `first` to before `first + count`.
typedef struct {
  // The first one.
  uint32_t first;
  // How many.
  uint32_t count;
} pm_range;

// What indices are: one of `PM_INDICES_...`.
typedef uint32_t pm_indices_kind;

// Indices of boxes. `pm_index`, `pm_index_range` and `pm_index_list` write them.
typedef struct {
  // `PM_INDICES_...`.
  pm_indices_kind kind;
  // Of a range or a mask: the first one.
  uint32_t first;
  // How many indices, or values.
  size_t count;
  // Of a list or a mask.
  const uint32_t *values;
} pm_indices;

// Which answer is wanted of an edit: one of `PM_REPORT_...`.
typedef uint32_t pm_report;

// What becomes of a dead writer's boxes: one of `PM_AT_END_...`.
typedef uint32_t pm_at_end;

// What a member asks of a shared scene. Zeros leave it open: the first member or the daemon decides.
typedef struct {
  // `sizeof(pm_join_options)`.
  size_t struct_size;
  // How long a tick is open after its first commit, at the most, ns: 100 ms unless a member says so, 10 s at most.
  uint64_t tick_deadline_ns;
  // Indices are below this.
  uint32_t most_boxes;
  // `PM_AT_END_...`.
  pm_at_end at_end;
  // 1 for a member that is told of all pairs; 0 for those of its own boxes.
  uint32_t all_pairs;
  // `PM_MARGINS_NEAR` for boxes with margins, or `PM_MARGINS_NONE`.
  pm_margins margins;
  // The margin of boxes that are set without one.
  float usual_margin;
  // Zero.
  uint32_t reserved;
} pm_join_options;

// Where pairs are found: one of `PM_BACKEND_...`. The pairs are the same.
typedef uint32_t pm_backend;

// Settings of a session. Zeros mean that the library chooses. Texts are read by `pm_session_connect` alone.
typedef struct {
  // `sizeof(pm_session_options)`.
  size_t struct_size;
  // Name of the daemon's instance; null for `default`.
  const char *instance;
  // Directory where instances live; null for `$PAIRMASK_RUNTIME_DIR` and what stands in for it.
  const char *runtime_dir;
  // One engine and no other, by a name that `pairmaskd cull --help` lists at `--engine`; null for the plan's
  // choice.
  const char *engine;
  // One encoding and no other: `dense`, `sparse` or `list`; null for the plan's choice.
  const char *encoding;
  // Instruction set of this process's engines and decoders; null for `$PAIRMASK_ISA`, else the widest.
  const char *isa;
  // `PM_BACKEND_...`.
  pm_backend backend;
  // Threads that an engine may use.
  uint32_t threads;
  // Threads with which pairs are visited.
  uint32_t visit_threads;
  // Boxes that the first segment should hold.
  uint32_t capacity;
  // How long to spin for an answer beyond its expected time, ns; `UINT64_MAX` for never.
  uint64_t spin_ns;
  // How long a wait waits, ns; 5 s unless set.
  uint64_t deadline_ns;
  // 1 where a frame that is equal to the last one is culled anew: for measurements.
  uint32_t no_repeats;
  // Zero.
  uint32_t reserved;
} pm_session_options;

// What a daemon tells of itself.
typedef struct {
  // `sizeof(pm_daemon_status)`, set by the caller.
  size_t struct_size;
  // Id of its process.
  uint32_t pid;
  // Clients that are connected.
  uint32_t client_count;
  // Nanoseconds since it began to serve.
  uint64_t uptime_ns;
  // Frames answered.
  uint64_t frames;
  // Boxes in those frames.
  uint64_t boxes;
  // Pairs in those frames.
  uint64_t pairs;
  // Spheres in those frames.
  uint64_t spheres;
  // Requests answered with an error.
  uint64_t errors;
  // Scenes that it keeps.
  uint32_t scenes;
  // Memory that they take, MiB.
  uint32_t scene_mib;
} pm_daemon_status;

// Done.
#define PM_OK 0

// An argument is wrong: a null pointer, a number that stands for nothing, a text that is no UTF-8.
#define PM_ERR_ARGUMENT 1

// The handle is zero, was dropped, or is of another kind.
#define PM_ERR_HANDLE 2

// Another call uses the handle: of another thread, or the one whose callback this is.
#define PM_ERR_BUSY 3

// The object cannot do that: spheres of a frame of boxes, a lease of a scene that is not shared, an answer
// of a scene that has none.
#define PM_ERR_STATE 4

// A bug of this library. The objects of the call cannot be used any more.
#define PM_ERR_PANIC 5

// More live handles than there are ids.
#define PM_ERR_TOO_MANY_HANDLES 6

// No daemon serves the instance.
#define PM_ERR_NO_DAEMON 10

// This library was built without the transport.
#define PM_ERR_NOT_BUILT_IN 11

// The daemon lives and did not answer in time.
#define PM_ERR_SILENT 12

// The instance is another user's.
#define PM_ERR_OTHER_USER 13

// The daemon speaks another major version of the wire contract.
#define PM_ERR_VERSION_MISMATCH 14

// The daemon has no slot for another client.
#define PM_ERR_TOO_MANY_CLIENTS 15

// No shared memory is left.
#define PM_ERR_OUT_OF_SHARED_MEMORY 16

// The instruction set is unknown, or this machine does not have it.
#define PM_ERR_ISA 17

// No name of an instance, or its directory cannot be used.
#define PM_ERR_INSTANCE 18

// The transport failed.
#define PM_ERR_TRANSPORT 19

// More boxes or spheres than an index can name.
#define PM_ERR_TOO_MANY_BOXES 30

// The lists of a frame's rules are too long to be sent.
#define PM_ERR_TOO_MANY_LISTED_PAIRS 32

// The first of two sets has more boxes than the frame.
#define PM_ERR_FIRST_SET 33

// Three frames are being filled, under way or held as masks.
#define PM_ERR_TOO_MANY_FRAMES 34

// The engine failed, or the one asked for is not here.
#define PM_ERR_CULL 35

// No answer yet. What was waited for is still under way.
#define PM_ERR_TIMEOUT 50

// The daemon died before it answered.
#define PM_ERR_DAEMON_DIED 51

// The daemon answered with an error, or with something that is malformed.
#define PM_ERR_REPLY 52

// The answer was taken before.
#define PM_ERR_TAKEN 53

// An index beyond what the scene may hold.
#define PM_ERR_BEYOND_LIMIT 70

// Not one box, or tag, for each index.
#define PM_ERR_LENGTHS 71

// Not one margin for each box, nor one for all; or a margin that is negative or not finite.
#define PM_ERR_MARGINS 72

// An index is set twice in one edit.
#define PM_ERR_SET_TWICE 73

// An index has no box.
#define PM_ERR_ABSENT 74

// A box with a margin in a scene whose boxes have none.
#define PM_ERR_NO_MARGINS 75

// No memory of this process is left.
#define PM_ERR_OUT_OF_MEMORY 76

// More queries and indices than a mask has objects.
#define PM_ERR_TOO_MANY_QUERIES 77

// Not one tag for each query, nor one for all.
#define PM_ERR_QUERY_TAGS 78

// More than 65,536 filters.
#define PM_ERR_TOO_MANY_FILTERS 79

// Bounds that are empty or not finite.
#define PM_ERR_BOUNDS 80

// No name of a shared scene.
#define PM_ERR_SCENE_NAME 90

// The session answers in process, where there is no shared scene.
#define PM_ERR_IN_PROCESS 91

// The shared scene has other terms.
#define PM_ERR_TERMS_DIFFER 93

// The lease is refused.
#define PM_ERR_LEASE 94

// The edit names what is not leased.
#define PM_ERR_NOT_LEASED 95

// An error of a later version of the library's parts, which this one has no code for.
#define PM_ERR_OTHER 99

// A bit for every pair of boxes.
#define PM_ENCODING_DENSE 0

// The words that are not zero, and where they belong.
#define PM_ENCODING_SPARSE 1

// The pairs.
#define PM_ENCODING_LIST 2

// 24 bytes a box, exact.
#define PM_FORM_F32 0

// 12 bytes a box, in steps of the bounds' extent / 65,534.
#define PM_FORM_Q16 1

// 6 bytes a box, in steps of the bounds' extent / 254.
#define PM_FORM_Q8 2

// 12 bytes a box, half floats.
#define PM_FORM_F16 3

// Something failed.
#define PM_LOG_ERROR 1

// Something is not as it was meant, such as frames that this process answers for want of a daemon.
#define PM_LOG_WARNING 2

// Something of note happened.
#define PM_LOG_INFO 3

// Boxes have no margins.
#define PM_MARGINS_NONE 0

// Answers are those of the boxes as they were set.
#define PM_MARGINS_EXACT 1

// Near pairs are among the answers.
#define PM_MARGINS_NEAR 2

// From `first` to before `first + count`.
#define PM_INDICES_RANGE 0

// The `count` values, in any order.
#define PM_INDICES_LIST 1

// The bits of `count` values: bit t of value w is index `first + 32 w + t`.
#define PM_INDICES_MASK 2

// Pairs that began and ended since the last answer that was waited for.
#define PM_REPORT_CHANGES 0

// Pairs of now with at least one box that the edit set, switched or flagged.
#define PM_REPORT_MOVED 1

// All pairs of now.
#define PM_REPORT_ALL 2

// Nothing: the edit is applied.
#define PM_REPORT_NOTHING 3

// As the others say; they are removed where nobody says anything.
#define PM_AT_END_ANY 0

// They are removed.
#define PM_AT_END_REMOVE 1

// They stay, for who leases their indices next.
#define PM_AT_END_KEEP 2

// The daemon where one answers, else in process. The session returns to the daemon by itself.
#define PM_BACKEND_AUTO 0

// The daemon, or an error.
#define PM_BACKEND_DAEMON 1

// The CPU engines of this library.
#define PM_BACKEND_IN_PROCESS 2

// The daemon, through shared memory.
#define PM_SERVED_BY_DAEMON 1

// This process.
#define PM_SERVED_BY_THIS_PROCESS 2

// A box of the pair was removed, also where its index has a new box.
#define PM_ENDED_REMOVED 0

// A box is switched off now, both are static now, or rules keep them apart.
#define PM_ENDED_FILTERED 1

// The boxes overlap no more.
#define PM_ENDED_SEPARATED 2

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// What was wrong with the last call of this thread that failed, in words; empty where none did. The text
// lives until another call of this thread fails.
const char *pm_last_error(void);

// The name of a code, `"PM_OK"` for one, or `"unknown code"`. The text lives as long as the process.
const char *pm_code_name(pm_code code);

// The f32 box around a box in f64, three numbers a corner, relative to `origin`, rounded outward: no pair is lost
// where all boxes of a frame have one origin.
pm_code pm_box_outward(const double *min,
                       const double *max,
                       const double *origin,
                       pm_box *b);

// What a box touches on its way from one place to another.
pm_code pm_box_swept(const pm_box *from,
                     const pm_box *to,
                     pm_box *b);

// A filter that meets everything.
pm_filter pm_filter_all(void);

// Rapier's `collision_groups`: memberships, filter, and whether the test mode is Or. `is_dynamic` is false for
// fixed and kinematic bodies.
pm_filter pm_filter_from_rapier(uint32_t memberships,
                                uint32_t filter,
                                bool is_or,
                                bool is_dynamic);

// Box2D's and Box3D's `b2Filter`.
pm_filter pm_filter_from_box2d(uint64_t category,
                               uint64_t mask,
                               int32_t group,
                               bool is_dynamic);

// Bullet's `m_collisionFilterGroup` and `m_collisionFilterMask`.
pm_filter pm_filter_from_bullet(int32_t group,
                                int32_t mask);

// Jolt's `ObjectLayerPairFilterMask`.
pm_filter pm_filter_from_jolt_mask(uint32_t group,
                                   uint32_t mask,
                                   bool is_dynamic);

// The words of a `PxFilterData` for the shader of PhysX's snippets: `word0` is what a shape is, `word1` what it
// meets.
pm_filter pm_filter_from_physx_words(uint32_t word0,
                                     uint32_t word1,
                                     bool is_dynamic);

// Newton's `shape_collision_group`.
pm_filter pm_filter_from_newton(int32_t group,
                                bool collides);

// MuJoCo's `contype` and `conaffinity`.
pm_filter pm_filter_from_mujoco(int32_t contype,
                                int32_t conaffinity);

// Begins a frame of `n` boxes. `boxes`, which may be null, is set to their memory, which is the caller's to
// write until the frame is submitted or dropped.
pm_code pm_session_frame(pm_session session,
                         size_t n,
                         pm_frame *frame,
                         pm_box **boxes);

// Begins a frame of `n` spheres. `spheres`, which may be null, is set to their memory.
pm_code pm_session_sphere_frame(pm_session session,
                                size_t n,
                                pm_frame *frame,
                                pm_sphere **spheres);

// Begins a frame of `n` boxes that are sent with less precision. They are written with `pm_frame_write` and
// `pm_frame_set`.
pm_code pm_session_narrow_frame(pm_session session,
                                size_t n,
                                const pm_precision *precision,
                                pm_frame *frame);

// Drops a frame that is not submitted.
pm_code pm_frame_drop(pm_frame frame);

// The memory of a frame's boxes.
pm_code pm_frame_boxes(pm_frame frame,
                       pm_box **boxes,
                       size_t *n);

// The memory of a frame's spheres.
pm_code pm_frame_spheres(pm_frame frame,
                         pm_sphere **spheres,
                         size_t *n);

// Copies all boxes of a frame from an array. Large frames are copied by several threads.
pm_code pm_frame_write(pm_frame frame,
                       const pm_box *boxes,
                       size_t n);

// Writes all boxes of a frame from their smallest and largest corners, three floats each.
pm_code pm_frame_write_corners(pm_frame frame,
                               const float *min,
                               const float *max,
                               size_t n);

// Writes all boxes of a frame from their centres and half extents, three floats each.
pm_code pm_frame_write_centers(pm_frame frame,
                               const float *center,
                               const float *half,
                               size_t n);

// Writes all boxes of a frame as what boxes in their objects' own coordinates cover once the objects are
// placed. They are rounded outward: no pair is lost.
pm_code pm_frame_write_placed(pm_frame frame,
                              const pm_box *locals,
                              const pm_placement *placements,
                              size_t n);

// Writes one box of a frame.
pm_code pm_frame_set(pm_frame frame,
                     uint32_t index,
                     const pm_box *b);

// Sends a frame. `options` may be null. The handle names nothing any more, and its memory is not the caller's,
// whatever is returned.
pm_code pm_frame_submit(pm_frame frame,
                        const pm_frame_options *options,
                        pm_pending *pending);

// Copies boxes, sends them and waits: the shortest way from boxes to pairs. `filters` may be zero. Where frames and
// masks hold all of the session's places at a daemon, it waits for one, as long as the session's deadline allows.
pm_code pm_session_cull(pm_session session,
                        const pm_box *boxes,
                        size_t n,
                        pm_rules filters,
                        pm_mask *mask);

// Hands the library's log to the program. It can be set once: `PM_ERR_STATE` after that.
pm_code pm_set_log(pm_log log,
                   void *user);

// Waits for the pairs, as long as the session's deadline allows. The handle names nothing any more, whatever
// is returned. With `PM_BACKEND_AUTO` no failure of the daemon is an error: this process answers then.
pm_code pm_pending_wait(pm_pending pending,
                        pm_mask *mask);

// Waits for the pairs, at most so many nanoseconds; with 0 it looks whether they have come. After
// `PM_ERR_TIMEOUT` the frame is still under way, and after `PM_ERR_ARGUMENT` and `PM_ERR_BUSY` nothing was
// done; else the handle names nothing any more.
pm_code pm_pending_wait_timeout(pm_pending pending,
                                uint64_t timeout_ns,
                                pm_mask *mask);

// Drops a frame that is under way: nobody wants its pairs.
pm_code pm_pending_drop(pm_pending pending);

// Drops a mask, and what was decoded of it.
pm_code pm_mask_drop(pm_mask mask);

// How many pairs there are.
pm_code pm_mask_count(pm_mask mask,
                      uint64_t *count);

// Whether two boxes are a pair.
pm_code pm_mask_contains(pm_mask mask,
                         uint32_t a,
                         uint32_t b,
                         bool *contains);

// All pairs as an array, which lives until the mask is dropped. A list in this process's memory is given where
// it lies; else the pairs are decoded once, into memory that the session uses again.
pm_code pm_mask_pairs(pm_mask mask,
                      const pm_pair **pairs,
                      size_t *count);

// Calls `visit` with pairs, some at a time, until all were seen: the fastest way through a mask, without a copy
// of it.
pm_code pm_mask_for_each(pm_mask mask,
                         pm_visit visit,
                         void *user);

// Calls `visit` with the words of a mask that are not zero, some at a time: for AND masks of the caller's own.
// Each pair of a mask that is a list is a word of one bit.
pm_code pm_mask_for_each_word(pm_mask mask,
                              pm_visit_words visit,
                              void *user);

// The box index at each position of a mask with sparse words, as an array that lives until the mask is dropped.
// Null where a position is an index: every mask that is not sparse, and some that are.
pm_code pm_mask_order(pm_mask mask,
                      const uint32_t **order,
                      size_t *count);

// The pairs of one world, as an array that lives until the mask is dropped; none where the world has none. Only
// masks of frames whose rules have worlds know them; `PM_ERR_STATE` from others.
pm_code pm_mask_pairs_of_world(pm_mask mask,
                               int32_t world,
                               const pm_pair **pairs,
                               size_t *count);

// Facts about the frame beside its pairs. Set `info->struct_size` first.
pm_code pm_mask_info(pm_mask mask,
                     pm_frame_info *info);

// All that was found, as an array that lives until the answer is dropped: `a` is the query, `b` the index.
pm_code pm_found_pairs(pm_found found,
                       const pm_pair **pairs,
                       size_t *count);

// Calls `visit` with what was found, some at a time: `a` is the query, `b` the index.
pm_code pm_found_for_each(pm_found found,
                          pm_visit visit,
                          void *user);

// Drops an answer.
pm_code pm_found_drop(pm_found found);

// Makes rules.
pm_code pm_rules_create(const pm_rules_desc *desc,
                        pm_rules *rules);

// Drops rules. Frames that were submitted with them keep them.
pm_code pm_rules_drop(pm_rules rules);

// Makes a scene. `options` may be null. A daemon keeps the scene where the session has one; else this process
// does.
pm_code pm_scene_create(pm_session session,
                        const pm_scene_options *options,
                        pm_scene *scene);

// Drops a scene. A shared one is left.
pm_code pm_scene_drop(pm_scene scene);

// Forgets what was told: the next changes are a resync. The scene's answer ends.
pm_code pm_scene_resync(pm_scene scene);

// The box of an index, also one that is switched off; `PM_ERR_ABSENT` where there is none. The scene's answer
// stays; an edit under way is not waited for any more.
pm_code pm_scene_get(pm_scene scene,
                     uint32_t index,
                     pm_box *b);

// Facts about a scene. Set `info->struct_size` first. The scene's answer stays; an edit under way is not waited for
// any more.
pm_code pm_scene_get_info(pm_scene scene,
                          pm_scene_info *info);

// Asks which boxes of a scene some other boxes overlap. `tags` are null, or one for all, or one for each: then only
// what may meet such a tag is found. The scene's answer ends. A shared scene is asked as the last tick made it.
pm_code pm_scene_query(pm_scene scene,
                       const pm_box *boxes,
                       size_t n,
                       const pm_tag *tags,
                       size_t tag_count,
                       pm_found *found);

// Facts about the answer. Set `answer->struct_size` first.
pm_code pm_scene_answer(pm_scene scene,
                        pm_answer *answer);

// Pairs that began, for `PM_REPORT_CHANGES`, as an array that lives until the answer ends: with the next call
// that writes or sends an edit, queries the scene, or leases.
pm_code pm_scene_begun(pm_scene scene,
                       const pm_pair **pairs,
                       size_t *count);

// Pairs of now, for `PM_REPORT_ALL`, `PM_REPORT_MOVED` and a resync, as an array that lives until the answer ends.
pm_code pm_scene_pairs(pm_scene scene,
                       const pm_pair **pairs,
                       size_t *count);

// Pairs that ended, for `PM_REPORT_CHANGES`, as an array that lives until the answer ends.
pm_code pm_scene_ended(pm_scene scene,
                       const pm_ended **ended,
                       size_t *count);

// Calls `visit` with the pairs that began, some at a time, without a copy of the list.
pm_code pm_scene_for_each_begun(pm_scene scene,
                                pm_visit visit,
                                void *user);

// Calls `visit` with the pairs of now, some at a time, without a copy of the list.
pm_code pm_scene_for_each_pair(pm_scene scene,
                               pm_visit visit,
                               void *user);

// Leases of writers that had not committed when the tick ended, of a shared scene: at most `capacity` of them are
// written, and `count` is how many there are.
pm_code pm_scene_late(pm_scene scene,
                      pm_range *ranges,
                      size_t capacity,
                      size_t *count);

// One index.
pm_indices pm_index(uint32_t index);

// Indices from `first` to before `first + count`.
pm_indices pm_index_range(uint32_t first,
                          size_t count);

// Indices as a list, in any order.
pm_indices pm_index_list(const uint32_t *values,
                         size_t count);

// Sets the box of an index; inserts it where there is none. The box is copied. In a scene with margins it has the
// usual one.
pm_code pm_scene_set(pm_scene scene,
                     uint32_t index,
                     const pm_box *b);

// As `pm_scene_set`, with a margin of its own. A scene without margins knows that of 0 alone.
pm_code pm_scene_set_margined(pm_scene scene,
                              uint32_t index,
                              const pm_box *b,
                              float margin);

// Sets boxes: one for each index. The arrays are read where they lie, until the edit is answered.
pm_code pm_scene_set_all(pm_scene scene,
                         pm_indices indices,
                         const pm_box *boxes,
                         size_t n);

// As `pm_scene_set_all`, with a margin for all boxes, or one for each. Margins are copied.
pm_code pm_scene_set_all_margined(pm_scene scene,
                                  pm_indices indices,
                                  const pm_box *boxes,
                                  size_t n,
                                  const float *margins,
                                  size_t margin_count);

// Removes boxes.
pm_code pm_scene_remove(pm_scene scene,
                        pm_indices indices);

// Switches boxes off (they overlap nothing) or on.
pm_code pm_scene_switch(pm_scene scene,
                        pm_indices indices,
                        bool on);

// Makes boxes static (two static boxes are no pair) or not.
pm_code pm_scene_make_static(pm_scene scene,
                             pm_indices indices,
                             bool is_static);

// Gives boxes their tags: one for each index. A box that is inserted has a tag of zeros. Whether a box itself is
// static, `pm_scene_make_static` says, and not its tag. The arrays are read where they lie, until the edit is
// answered.
pm_code pm_scene_tag(pm_scene scene,
                     pm_indices indices,
                     const pm_tag *tags,
                     size_t n);

// The filters that tags name, in place of all before. They are copied.
pm_code pm_scene_filters(pm_scene scene,
                         const pm_filter *filters,
                         size_t n);

// Puts pairs of indices on the include list, or takes them off. The array is read where it lies, until the edit is
// answered.
pm_code pm_scene_include(pm_scene scene,
                         const pm_pair *pairs,
                         size_t n,
                         bool on);

// Puts pairs of indices on the exclude list, or takes them off, as `pm_scene_include` does.
pm_code pm_scene_exclude(pm_scene scene,
                         const pm_pair *pairs,
                         size_t n,
                         bool on);

// Forgets the edit that is being written.
pm_code pm_scene_discard(pm_scene scene);

// Sends the edit that was written: removals first, then boxes that are set, then switches and static flags in
// their order, then what is about rules. A daemon works on it while this thread does something else.
// Whatever is returned, the edit is written no more.
pm_code pm_scene_submit(pm_scene scene,
                        pm_report report);

// Waits for the answer to what was submitted, as long as the session's deadline allows, and for a shared scene
// until its tick ends. That acknowledges it: what it reports is not reported again. After an error the edit is applied,
// and the next answer makes up for this one.
pm_code pm_scene_wait(pm_scene scene);

// `pm_scene_submit` and `pm_scene_wait`.
pm_code pm_scene_commit(pm_scene scene,
                        pm_report report);

// Joins a scene that several processes write, by its name: 1 to 64 letters, digits and `-_.:/`. It needs a daemon.
// `options` may be null.
pm_code pm_scene_join(pm_session session,
                      const char *name,
                      const pm_join_options *options,
                      pm_scene *scene);

// Leases a range of indices: this member alone may set boxes there.
pm_code pm_scene_lease(pm_scene scene,
                       pm_range range);

// Leases the lowest free range of so many indices. Which one that is depends on who came first.
pm_code pm_scene_lease_any(pm_scene scene,
                           uint32_t count,
                           pm_range *range);

// Gives back the lease that begins at an index. Its boxes are removed.
pm_code pm_scene_give_back(pm_scene scene,
                           uint32_t first);

// The ranges that this member has leased: at most `capacity` of them are written, and `count` is how many there
// are.
pm_code pm_scene_leases(pm_scene scene,
                        pm_range *ranges,
                        size_t capacity,
                        size_t *count);

// What holds in a shared scene: indices are below `most_boxes`, and a tick is open for `tick_deadline_ns` after its
// first commit, at the most.
pm_code pm_scene_terms(pm_scene scene,
                       uint32_t *most_boxes,
                       uint64_t *tick_deadline_ns);

// Makes a session. `options` may be null. With `PM_BACKEND_AUTO` a missing daemon is no error.
pm_code pm_session_connect(const pm_session_options *options,
                           pm_session *session);

// Ends a session. What came of it lives on: frames, masks and scenes.
pm_code pm_session_drop(pm_session session);

// What would serve the next frame by the present state.
pm_code pm_session_served_by(pm_session session,
                             pm_served_by *served_by);

// Asks the daemon for its status.
pm_code pm_session_daemon_status(pm_session session,
                                 pm_daemon_status *status);

// The version of the library that was loaded, as `PM_VERSION` writes it. Before 1.0, a program works with
// libraries of its minor version; from then on, with those of its major version that are not older.
uint32_t pm_version(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* PAIRMASK_H */
