/* Every call of the header, and every error that a program can make, in C. */
#include "check.h"

#include <math.h>

static pm_box at(float x) { return (pm_box){{x, 0, 0}, {x + 1, 1, 1}}; }

static void check_pairs(const pm_pair *pairs, size_t count, const pm_pair *expected, size_t n) {
  CHECK(count == n && (n == 0 || memcmp(pairs, expected, n * sizeof *pairs) == 0));
}

static pm_frame written(pm_session session, const pm_box *boxes, size_t n) {
  pm_frame frame;
  EXPECT(PM_OK, pm_session_frame(session, n, &frame, NULL));
  EXPECT(PM_OK, pm_frame_write(frame, boxes, n));
  return frame;
}

static pm_mask submitted(pm_frame frame) {
  pm_pending pending;
  pm_mask mask;
  EXPECT(PM_OK, pm_frame_submit(frame, NULL, &pending));
  EXPECT(PM_OK, pm_pending_wait(pending, &mask));
  return mask;
}

static pm_mask culled(pm_session session, const pm_box *boxes, size_t n, pm_rules rules) {
  pm_mask mask;
  EXPECT(PM_OK, pm_session_cull(session, boxes, n, rules, &mask));
  return mask;
}

static void expect_pairs(pm_mask mask, const pm_pair *expected, size_t n) {
  const pm_pair *pairs;
  size_t count;
  EXPECT(PM_OK, pm_mask_pairs(mask, &pairs, &count));
  check_pairs(pairs, count, expected, n);
  EXPECT(PM_OK, pm_mask_drop(mask));
}

static void arguments(pm_session session) {
  const pm_session none = {0};
  const pm_box b = at(0);
  pm_session other;
  pm_frame frame;
  pm_box *boxes;
  pm_mask mask;

  CHECK(pm_version() == PM_VERSION);
  EXPECT(PM_ERR_HANDLE, pm_session_frame(none, 1, &frame, &boxes));
  CHECK(strstr(pm_last_error(), "PM_ERR_HANDLE: the handle names nothing") == pm_last_error());
  EXPECT(PM_ERR_ARGUMENT, pm_session_frame(session, 1, NULL, &boxes));
  EXPECT(PM_ERR_ARGUMENT, pm_session_connect(NULL, NULL));
  EXPECT(PM_OK, pm_session_drop(none));

  const struct {
    pm_code code;
    pm_session_options options;
  } refused[] = {
      {PM_ERR_ARGUMENT, {.backend = PM_BACKEND_AUTO}}, /* struct_size is not set */
      {PM_ERR_ARGUMENT, {SIZED(pm_session_options), .backend = 9}},
      {PM_ERR_ARGUMENT, {SIZED(pm_session_options), .engine = "warp-drive"}},
      {PM_ERR_ARGUMENT, {SIZED(pm_session_options), .engine = "\xff\xfe"}},
      {PM_ERR_ISA, {SIZED(pm_session_options), .isa = "fast"}},
      {PM_ERR_INSTANCE, {SIZED(pm_session_options), .instance = "no/such name"}},
      {PM_ERR_NO_DAEMON,
       {SIZED(pm_session_options), .instance = "nobody-serves-this", .backend = PM_BACKEND_DAEMON}},
  };
  for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
    EXPECT(refused[i].code, pm_session_connect(&refused[i].options, &other));
  }
  /* As from a program with an older header: the rest is as if it were zero. */
  const pm_session_options older = {.struct_size = sizeof(size_t), .backend = 9};
  EXPECT(PM_OK, pm_session_connect(&older, &other));
  EXPECT(PM_OK, pm_session_drop(other));
  EXPECT(PM_ERR_HANDLE, pm_session_drop(other));

  EXPECT(PM_OK, pm_session_frame(session, 2, &frame, NULL));
  EXPECT(PM_ERR_ARGUMENT, pm_frame_write(frame, &b, 1));
  EXPECT(PM_ERR_ARGUMENT, pm_frame_write(frame, NULL, 2));
  EXPECT(PM_ERR_ARGUMENT, pm_frame_set(frame, 2, &b));
  EXPECT(PM_OK, pm_frame_drop(frame));
  EXPECT(PM_ERR_HANDLE, pm_frame_set(frame, 0, &b));
  EXPECT(PM_ERR_ARGUMENT, pm_session_cull(session, (const pm_box *)((const char *)&b + 1), 1,
                                          (pm_rules){0}, &mask)); /* not aligned */
  EXPECT(PM_ERR_ARGUMENT, pm_session_cull(session, &b, SIZE_MAX, (pm_rules){0}, &mask));
  EXPECT(PM_ERR_TOO_MANY_BOXES, pm_session_frame(session, SIZE_MAX, &frame, NULL));
  for (int i = 0; i < 4; i++) { /* not aligned: no frame is made, which would hold a slot */
    char *at = (char *)&boxes + 1;
    EXPECT(PM_ERR_ARGUMENT, pm_session_frame(session, 1, &frame, (pm_box **)at));
    EXPECT(PM_ERR_ARGUMENT, pm_session_sphere_frame(session, 1, &frame, (pm_sphere **)at));
  }
}

static void too_many_frames(pm_session session) {
  pm_frame frames[4];
  pm_served_by by;
  EXPECT(PM_OK, pm_session_served_by(session, &by));
  /* A session in process has no such limit. */
  const int most = by == PM_SERVED_BY_DAEMON ? 3 : 4;
  for (int i = 0; i < 4; i++) {
    EXPECT(i < most ? PM_OK : PM_ERR_TOO_MANY_FRAMES, pm_session_frame(session, 1, &frames[i], NULL));
  }
  for (int i = 0; i < most; i++) {
    EXPECT(PM_OK, pm_frame_drop(frames[i]));
  }
}

static void count_words(void *user, const pm_word *words, size_t count) {
  for (size_t i = 0; i < count; i++) {
    for (uint32_t bits = words[i].bits; bits != 0; bits &= bits - 1) {
      *(uint64_t *)user += 1;
    }
  }
}

static void busy(void *user, const pm_pair *pairs, size_t count) {
  const pm_mask *mask = user;
  bool contains;
  (void)pairs;
  (void)count;
  EXPECT(PM_ERR_BUSY, pm_mask_contains(*mask, 0, 1, &contains));
}

static void frames(pm_session session) {
  const pm_pair expected[] = {{0, 1}, {1, 2}};
  const float min[] = {0, 0, 0, 0.75f, 0, 0, 1.5f, 0, 0};
  const float max[] = {1, 1, 1, 1.75f, 1, 1, 2.5f, 1, 1};
  const float center[] = {0.5f, 0.5f, 0.5f, 1.25f, 0.5f, 0.5f, 2, 0.5f, 0.5f};
  const float half[] = {0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f};
  const pm_box three[] = {at(0), at(0.75f), at(1.5f)};
  const pm_box locals[] = {at(0), at(0), at(0)};
  const pm_placement placed[] = {
      {{0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1}},
      {{0.75f, 0, 0}, {0, 0, 0, 1}, {1, 1, 1}},
      {{1.5f, 0, 0}, {0, 0, 0, 1}, {1, 1, 1}},
  };
  pm_frame frame;
  pm_pending pending;
  pm_mask mask;
  pm_box *boxes;

  for (int way = 0; way < 6; way++) {
    EXPECT(PM_OK, pm_session_frame(session, 3, &frame, &boxes));
    memcpy(boxes, way == 0 ? three : locals, sizeof three);
    EXPECT(PM_OK, way == 1   ? pm_frame_write(frame, three, 3)
                  : way == 2 ? pm_frame_write_corners(frame, min, max, 3)
                  : way == 3 ? pm_frame_write_centers(frame, center, half, 3)
                  : way == 4 ? pm_frame_write_placed(frame, locals, placed, 3)
                             : PM_OK);
    for (uint32_t i = 0; i < 3 && way == 5; i++) {
      EXPECT(PM_OK, pm_frame_set(frame, i, &three[i]));
    }
    CHECK(boxes[2].min[0] <= 1.5f && boxes[2].min[0] > 1.49f); /* placed: outward */
    expect_pairs(submitted(frame), expected, 2);
  }

  mask = culled(session, three, 3, (pm_rules){0});
  bool contains;
  EXPECT(PM_OK, pm_mask_contains(mask, 1, 0, &contains));
  CHECK(contains);
  EXPECT(PM_OK, pm_mask_contains(mask, 0, 2, &contains));
  CHECK(!contains);
  EXPECT(PM_OK, pm_mask_for_each(mask, busy, &mask));
  EXPECT(PM_ERR_ARGUMENT, pm_mask_for_each(mask, NULL, NULL));
  pm_frame_info info = {SIZED(pm_frame_info)};
  EXPECT(PM_OK, pm_mask_info(mask, &info));
  CHECK(info.n == 3 && strlen(info.engine) > 0 && strlen(info.engine) < sizeof info.engine);
  CHECK(info.pair_count == 2 && (info.order == NULL) == (info.order_count == 0));
  if (info.encoding != PM_ENCODING_LIST) {
    uint64_t seen = 0;
    EXPECT(PM_OK, pm_mask_for_each_word(mask, count_words, &seen));
    CHECK(seen == 2);
  }
  expect_pairs(mask, expected, 2);
  EXPECT(PM_ERR_HANDLE, pm_mask_drop(mask));

  pm_frame_options options = {sizeof options, {0}, 1, 1};
  EXPECT(PM_OK, pm_frame_submit(written(session, three, 3), &options, &pending));
  pm_code code;
  do {
    code = pm_pending_wait_timeout(pending, 1000000, &mask);
  } while (code == PM_ERR_TIMEOUT);
  EXPECT(PM_OK, code);
  EXPECT(PM_ERR_HANDLE, pm_pending_wait(pending, &mask));
  expect_pairs(mask, expected, 1);

  frame = written(session, three, 3);
  options.split_at = 4;
  EXPECT(PM_ERR_FIRST_SET, pm_frame_submit(frame, &options, &pending));
  EXPECT(PM_ERR_HANDLE, pm_frame_drop(frame)); /* it was dropped, regardless of what was returned */

  EXPECT(PM_OK, pm_frame_submit(written(session, three, 3), NULL, &pending));
  EXPECT(PM_OK, pm_pending_drop(pending));
  expect_pairs(submitted(written(session, NULL, 0)), expected, 0);

  pm_sphere *spheres;
  EXPECT(PM_OK, pm_session_sphere_frame(session, 3, &frame, &spheres));
  for (int i = 0; i < 3; i++) {
    spheres[i] = (pm_sphere){{2.0f * (float)i, 0, 0}, 1};
  }
  EXPECT(PM_ERR_STATE, pm_frame_set(frame, 0, three));
  EXPECT(PM_ERR_STATE, pm_frame_write(frame, three, 3));
  expect_pairs(submitted(frame), expected, 2);
}

static void narrow(pm_session session) {
  const pm_pair expected[] = {{0, 1}};
  const pm_box two[] = {{{0, 0, 0}, {1, 1, 1}}, {{1.0005f, 0, 0}, {2, 1, 1}}};
  pm_precision precision = {PM_FORM_Q16, {{-100, -100, -100}, {100, 100, 100}}};
  pm_frame frame;

  for (pm_form form = PM_FORM_Q16; form <= PM_FORM_F16; form++) {
    precision.form = form;
    EXPECT(PM_OK, pm_session_narrow_frame(session, 2, &precision, &frame));
    EXPECT(PM_OK, pm_frame_write(frame, two, 2));
    EXPECT(PM_OK, pm_frame_set(frame, 1, &two[1]));
    EXPECT(PM_ERR_ARGUMENT, pm_frame_set(frame, 2, &two[1]));
    expect_pairs(submitted(frame), expected, 1);
  }
  precision.form = 9;
  EXPECT(PM_ERR_ARGUMENT, pm_session_narrow_frame(session, 2, &precision, &frame));
  precision.form = PM_FORM_Q8;
  precision.bounds.max[0] = NAN;
  EXPECT(PM_ERR_BOUNDS, pm_session_narrow_frame(session, 2, &precision, &frame));
}

static void rules(pm_session session) {
  const pm_pair listed[] = {{0, 3}};
  const pm_box four[] = {at(0), at(0.25f), at(0.5f), at(0.75f)};
  /* 0 and 1 have an owner, 2 another world, 1 and 3 do not admit each other. */
  const pm_filter_data filter_data[] = {{0, 7, 0, 0}, {0, 7, 1, 0}, {5, 0, 0, 0}, {0, 0, 2, 0}};
  const pm_filter filters[] = {{UINT64_MAX, UINT64_MAX, 0, 0, 0}, {1, 1, 0, 0, 0}, {2, 2, 0, 0, 0}};
  pm_rules_desc desc = {SIZED(pm_rules_desc), filter_data, 4, filters, 3, NULL, 0, NULL, 0};
  pm_rules made;
  pm_mask mask;

  EXPECT(PM_OK, pm_rules_create(&desc, &made));
  for (int again = 0; again < 3; again++) {
    mask = culled(session, four, 4, made);
    const pm_pair *pairs;
    size_t count;
    const pm_code code = pm_mask_pairs_of_world(mask, 5, &pairs, &count);
    CHECK((code == PM_OK && count == 0) || code == PM_ERR_STATE);
    expect_pairs(mask, listed, 1);
  }
  EXPECT(PM_OK, pm_rules_drop(made));
  EXPECT(PM_ERR_HANDLE, pm_session_cull(session, four, 4, made, &mask));

  /* A pair that is excluded, and one that is included too. */
  desc.excluded = desc.included = listed;
  desc.excluded_count = 1;
  for (desc.included_count = 0; desc.included_count < 2; desc.included_count++) {
    EXPECT(PM_OK, pm_rules_create(&desc, &made));
    expect_pairs(culled(session, four, 4, made), listed, desc.included_count);
    EXPECT(PM_OK, pm_rules_drop(made));
  }

  desc.filter_count = 65537;
  pm_filter *many = calloc(65537, sizeof *many);
  CHECK(many != NULL);
  desc.filters = many;
  EXPECT(PM_ERR_TOO_MANY_FILTERS, pm_rules_create(&desc, &made));
  free(many);

  CHECK(pm_filter_from_bullet(2, 5).category == 2 && pm_filter_from_bullet(2, 5).mask == 5);
  CHECK(pm_filter_from_box2d(1, 2, -3, true).group == -3);
  CHECK(pm_filter_from_rapier(1, 2, false, true).category == 1);
  CHECK(pm_filter_from_jolt_mask(1, 2, true).mask != 0);
  CHECK(pm_filter_from_physx_words(1, 2, true).mask != 0);
  CHECK(pm_filter_from_newton(1, true).mask != 0);
  CHECK(pm_filter_from_mujoco(1, 1).mask != 0);

  const double low[] = {1e9 + 0.25, 0, 0}, high[] = {1e9 + 1.25, 1, 1}, origin[] = {1e9, 0, 0};
  pm_box b;
  EXPECT(PM_OK, pm_box_outward(low, high, origin, &b));
  CHECK(b.min[0] == 0.25f && b.max[0] == 1.25f);
  b = pm_box_swept(at(0), at(5));
  CHECK(b.min[0] == 0 && b.max[0] == 6);
}

static void set(pm_scene scene, uint32_t index, pm_box b) {
  EXPECT(PM_OK, pm_scene_set(scene, index, &b, NULL));
}

static pm_indices one(uint32_t index) { return (pm_indices){.first = index, .count = 1}; }

static pm_answer committed(pm_scene scene, pm_report report) {
  pm_answer answer = {SIZED(pm_answer)};
  EXPECT(PM_OK, pm_scene_commit(scene, report, &answer));
  return answer;
}

/* Expects that so many pairs began and ended with an edit, which is `pair` for one, and why the pair ended. */
static void changes(pm_scene scene, pm_pair pair, size_t begun, size_t ended, pm_end_reason reason) {
  const pm_answer answer = committed(scene, PM_REPORT_CHANGES);
  check_pairs(answer.begun, answer.begun_count, &pair, begun);
  CHECK(answer.ended_count == ended && !answer.is_resync && answer.served_by != 0);
  if (ended == 1) {
    CHECK(answer.ended->a == pair.a && answer.ended->b == pair.b && answer.ended->reason == reason);
  }
}

/* Three boxes at one place in each of 40 worlds: the pairs of each are its own, in a list by world. */
static void worlds(const pm_session_options *of) {
  enum { WORLDS = 40, EACH = 3 };
  pm_session_options options = *of;
  pm_box boxes[WORLDS * EACH];
  pm_filter_data filter_data[WORLDS * EACH];
  const pm_rules_desc desc = {SIZED(pm_rules_desc), .filter_data = filter_data, .filter_data_count = WORLDS * EACH};
  pm_session session;
  pm_rules made;
  const pm_pair *pairs;
  size_t count;

  for (int i = 0; i < WORLDS * EACH; i++) {
    boxes[i] = at(0.1f * (float)(i % EACH));
    filter_data[i] = (pm_filter_data){i % WORLDS, 0, 0, 0};
  }
  options.encoding = "list";
  EXPECT(PM_OK, pm_session_connect(&options, &session));
  EXPECT(PM_OK, pm_rules_create(&desc, &made));
  pm_mask mask = culled(session, boxes, WORLDS * EACH, made);
  for (int world = 0; world < WORLDS; world++) {
    const uint32_t first = (uint32_t)world, second = first + WORLDS, third = second + WORLDS;
    const pm_pair expected[] = {{first, second}, {first, third}, {second, third}};
    EXPECT(PM_OK, pm_mask_pairs_of_world(mask, world, &pairs, &count));
    check_pairs(pairs, count, expected, 3);
  }
  EXPECT(PM_OK, pm_mask_pairs_of_world(mask, WORLDS, &pairs, &count));
  CHECK(count == 0);
  EXPECT(PM_ERR_ARGUMENT, pm_mask_pairs_of_world(mask, 0, NULL, &count));
  EXPECT(PM_OK, pm_mask_drop(mask));
  EXPECT(PM_ERR_HANDLE, pm_mask_pairs_of_world(mask, 0, &pairs, &count));
  mask = culled(session, boxes, WORLDS * EACH, (pm_rules){0});
  EXPECT(PM_ERR_STATE, pm_mask_pairs_of_world(mask, 0, &pairs, &count));
  EXPECT(PM_OK, pm_mask_drop(mask));
  EXPECT(PM_OK, pm_rules_drop(made));
  EXPECT(PM_OK, pm_session_drop(session));
}

static void scenes(pm_session session) {
  const pm_pair expected[] = {{7, 9}};
  const pm_scene_options options = {SIZED(pm_scene_options), .most_boxes = 1000};
  pm_answer answer = {SIZED(pm_answer)};
  pm_scene_info info = {SIZED(pm_scene_info)};
  const pm_box a = at(0), b = at(0.5f);
  const uint32_t values[] = {9, 7};
  const pm_indices both = {PM_INDICES_LIST, .count = 2, .values = values};
  const pm_box boxes[] = {at(0.5f), at(0)};
  const pm_pair *pairs;
  size_t count;
  pm_scene scene;

  EXPECT(PM_OK, pm_scene_create(session, &options, &scene));
  EXPECT(PM_ERR_STATE, pm_scene_wait(scene, &answer));

  set(scene, 7, a);
  set(scene, 9, b);
  EXPECT(PM_ERR_ARGUMENT, pm_scene_commit(scene, 9, NULL));
  pm_answer wrong = {.struct_size = 0};
  EXPECT(PM_ERR_ARGUMENT, pm_scene_commit(scene, PM_REPORT_CHANGES, &wrong));
  answer = committed(scene, PM_REPORT_CHANGES);
  CHECK(answer.ended_count == 0 && answer.all_pairs == 1 && answer.served_by != 0);
  check_pairs(answer.begun, answer.begun_count, expected, 1);
  EXPECT(PM_OK, pm_scene_wait(scene, &answer)); /* the same again */
  check_pairs(answer.begun, answer.begun_count, expected, 1);

  set(scene, 9, at(50));
  EXPECT(PM_ERR_STATE, pm_scene_wait(scene, &answer)); /* the answer has ended */
  EXPECT(PM_OK, pm_scene_submit(scene, PM_REPORT_CHANGES));
  EXPECT(PM_OK, pm_scene_wait(scene, NULL));
  EXPECT(PM_OK, pm_scene_wait(scene, &answer));
  CHECK(answer.ended_count == 1 && answer.ended->a == 7 && answer.ended->b == 9);
  CHECK(answer.ended->reason == PM_ENDED_SEPARATED);
  changes(scene, *expected, 0, 0, 0); /* nothing was written: nothing changes */

  EXPECT(PM_OK, pm_scene_set_all(scene, both, boxes, 2, NULL, 0));
  answer = committed(scene, PM_REPORT_ALL);
  check_pairs(answer.pairs, answer.pair_count, expected, 1);

  EXPECT(PM_OK, pm_scene_query(scene, &a, 1, NULL, 0, &pairs, &count));
  CHECK(count == 2 && pairs[0].a == 0 && pairs[0].b == 7 && pairs[1].b == 9);
  const pm_filter_data other_world = {1, 0, 0, 0};
  EXPECT(PM_OK, pm_scene_query(scene, &a, 1, &other_world, 1, &pairs, &count));
  CHECK(count == 0);
  const pm_filter_data filter_data[] = {other_world, other_world, other_world};
  EXPECT(PM_ERR_QUERY_FILTER_DATA, pm_scene_query(scene, &a, 1, filter_data, 3, &pairs, &count));

  const float away_from[3] = {256, 0, -2}, back[3] = {-256, 0, 2}, too_far[3] = {1e9f, 0, 0};
  EXPECT(PM_OK, pm_scene_shift_origin(scene, away_from));
  EXPECT(PM_OK, pm_scene_query(scene, &a, 1, NULL, 0, &pairs, &count));
  CHECK(count == 0);
  EXPECT(PM_ERR_INEXACT_SHIFT, pm_scene_shift_origin(scene, too_far));
  EXPECT(PM_ERR_ARGUMENT, pm_scene_shift_origin(scene, NULL));
  EXPECT(PM_OK, pm_scene_shift_origin(scene, back));
  changes(scene, *expected, 0, 0, 0); /* no pair has begun or ended */

  const uint64_t given[2] = {77, UINT64_MAX};
  const uint64_t *user_data = NULL;
  const uint32_t asked[3] = {9, 7, 8};
  const uint32_t named[2] = {7, 9};
  const pm_indices marked = {PM_INDICES_LIST, 0, 2, named};
  EXPECT(PM_OK, pm_scene_set_user_data(scene, marked, given, 2));
  EXPECT(PM_OK, pm_scene_commit(scene, PM_REPORT_NOTHING, NULL));
  EXPECT(PM_OK, pm_scene_get_user_data(scene, asked, 3, &user_data));
  CHECK(user_data[0] == UINT64_MAX && user_data[1] == 77 && user_data[2] == 0);
  EXPECT(PM_OK, pm_scene_set_user_data(scene, marked, given, 1));
  EXPECT(PM_ERR_LENGTHS, pm_scene_commit(scene, PM_REPORT_NOTHING, NULL));
  EXPECT(PM_ERR_ARGUMENT, pm_scene_get_user_data(scene, NULL, 3, &user_data));

  uint64_t snapshot;
  EXPECT(PM_OK, pm_scene_take_snapshot(scene, &snapshot));
  CHECK(snapshot != 0);
  EXPECT(PM_OK, pm_scene_shift_origin(scene, away_from));
  EXPECT(PM_OK, pm_scene_restore(scene, snapshot));
  EXPECT(PM_OK, pm_scene_query(scene, &a, 1, NULL, 0, &pairs, &count));
  CHECK(count == 2);
  changes(scene, *expected, 0, 0, 0);
  EXPECT(PM_ERR_SNAPSHOT, pm_scene_restore(scene, snapshot + 1));
  EXPECT(PM_OK, pm_scene_forget_snapshot(scene, snapshot));
  EXPECT(PM_ERR_SNAPSHOT, pm_scene_forget_snapshot(scene, snapshot));
  EXPECT(PM_ERR_SNAPSHOT, pm_scene_restore(scene, snapshot));
  EXPECT(PM_ERR_ARGUMENT, pm_scene_take_snapshot(scene, NULL));

  const char *path = "calls.pmscene";
  pm_scene loaded;
  EXPECT(PM_OK, pm_scene_save(scene, path));
  EXPECT(PM_OK, pm_session_load_scene(session, &options, path, &loaded));
  EXPECT(PM_OK, pm_scene_query(loaded, &a, 1, NULL, 0, &pairs, &count));
  CHECK(count == 2 && pairs[0].b == 7 && pairs[1].b == 9);
  EXPECT(PM_OK, pm_scene_drop(loaded));
  CHECK(remove(path) == 0);
  EXPECT(PM_ERR_SCENE_FILE, pm_session_load_scene(session, NULL, path, &loaded));
  EXPECT(PM_ERR_SCENE_FILE, pm_scene_save(scene, "/no/such/folder"));
  EXPECT(PM_ERR_ARGUMENT, pm_scene_save(scene, NULL));
  EXPECT(PM_ERR_ARGUMENT, pm_session_load_scene(session, NULL, NULL, &loaded));

  const float start = a.min[0] - 4;
  const pm_ray ray = {{start, a.min[1], a.min[2]}, {2, 0, 0}, INFINITY, {0, 0, 0}};
  const pm_ray away = {{start, a.min[1], a.min[2]}, {-1, 0, 0}, INFINITY, {0, 0, 0}};
  const pm_ray rays[] = {away, ray};
  const pm_hit *hits = NULL;
  EXPECT(PM_OK, pm_scene_cast(scene, rays, 2, PM_HITS_CLOSEST, 1, NULL, 0, &hits, &count));
  CHECK(count == 1 && hits->query == 1 && hits->index == 7 && hits->distance == 2);
  EXPECT(PM_OK, pm_scene_cast(scene, rays, 2, PM_HITS_ANY, 0, NULL, 0, &hits, &count));
  CHECK(count == 1 && hits->query == 1 && hits->index == PM_ANY_BOX);
  EXPECT(PM_OK, pm_scene_cast(scene, rays, 2, PM_HITS_ALL, 0, &other_world, 1, &hits, &count));
  CHECK(count == 0);
  EXPECT(PM_ERR_ARGUMENT, pm_scene_cast(scene, rays, 2, 9, 0, NULL, 0, &hits, &count));
  EXPECT(PM_ERR_QUERY_FILTER_DATA,
         pm_scene_cast(scene, rays, 2, PM_HITS_ALL, 0, filter_data, 3, &hits, &count));
  const pm_sphere sphere = {{start, a.min[1], a.min[2]}, INFINITY};
  EXPECT(PM_OK, pm_scene_nearest(scene, &sphere, 1, PM_HITS_ALL, 0, NULL, 0, &hits, &count));
  CHECK(count == 2 && hits[0].index == 7 && hits[0].distance == 4 && hits[1].index == 9);

  EXPECT(PM_OK, pm_scene_set_enabled(scene, one(7), false));
  changes(scene, *expected, 0, 1, PM_ENDED_FILTERED);
  EXPECT(PM_OK, pm_scene_set_enabled(scene, one(7), true));
  EXPECT(PM_OK, pm_scene_make_static(scene, both, true));
  changes(scene, *expected, 0, 0, 0);
  const uint32_t mask[] = {1u << 7 | 1u << 9};
  EXPECT(PM_OK, pm_scene_make_static(scene, (pm_indices){PM_INDICES_MASK, 0, 1, mask}, false));
  changes(scene, *expected, 1, 0, 0);

  const pm_filter filters[] = {{UINT64_MAX, UINT64_MAX, 0, 0, 0}, {1, 1, 0, 0, 0}, {2, 2, 0, 0, 0}};
  const pm_filter_data kinds[] = {{0, 0, 1, 0}, {0, 0, 2, 0}};
  EXPECT(PM_OK, pm_scene_filter_table(scene, filters, 3));
  EXPECT(PM_OK, pm_scene_set_filter(scene, both, kinds, 2));
  changes(scene, *expected, 0, 1, PM_ENDED_FILTERED);
  EXPECT(PM_OK, pm_scene_include(scene, expected, 1, true));
  changes(scene, *expected, 1, 0, 0);
  EXPECT(PM_OK, pm_scene_include(scene, expected, 1, false));
  EXPECT(PM_OK, pm_scene_exclude(scene, expected, 1, true));
  EXPECT(PM_OK, pm_scene_commit(scene, PM_REPORT_NOTHING, NULL));
  EXPECT(PM_OK, pm_scene_exclude(scene, expected, 1, false));
  EXPECT(PM_OK, pm_scene_set_filter(scene, one(7), &other_world, 1));
  EXPECT(PM_OK, pm_scene_discard(scene));

  /* What is wrong with an edit: nothing of it is applied. */
  const pm_indices three = {.first = 0, .count = 3};
  const float margin = 1;
  set(scene, 1000, a);
  EXPECT(PM_ERR_BEYOND_LIMIT, pm_scene_commit(scene, PM_REPORT_CHANGES, NULL));
  set(scene, 3, a);
  set(scene, 3, a);
  EXPECT(PM_ERR_SET_TWICE, pm_scene_commit(scene, PM_REPORT_CHANGES, NULL));
  EXPECT(PM_OK, pm_scene_remove(scene, one(3)));
  EXPECT(PM_ERR_ABSENT, pm_scene_commit(scene, PM_REPORT_CHANGES, NULL));
  EXPECT(PM_OK, pm_scene_set_all(scene, three, boxes, 2, NULL, 0));
  EXPECT(PM_ERR_LENGTHS, pm_scene_commit(scene, PM_REPORT_CHANGES, NULL));
  EXPECT(PM_ERR_ARGUMENT, pm_scene_remove(scene, (pm_indices){9, 0, 0, NULL}));
  EXPECT(PM_ERR_ARGUMENT, pm_scene_remove(scene, (pm_indices){PM_INDICES_LIST, 0, 3, NULL}));
  EXPECT(PM_OK, pm_scene_set_all(scene, one(1), &a, 1, &margin, 1));
  EXPECT(PM_ERR_NO_MARGINS, pm_scene_commit(scene, PM_REPORT_CHANGES, NULL));
  pm_box got;
  EXPECT(PM_ERR_ABSENT, pm_scene_get(scene, 3, &got));
  EXPECT(PM_OK, pm_scene_get(scene, 9, &got));
  CHECK(memcmp(&got, &b, sizeof got) == 0);
  EXPECT(PM_OK, pm_scene_get_info(scene, &info));
  CHECK(info.boxes == 2 && info.allocated_bytes > 0 && info.most_boxes == 1000);
  CHECK(info.tick_deadline_ns == 0 && info.lease_count == 0);
  EXPECT(PM_ERR_STATE, pm_scene_lease(scene, (pm_range){0, 1}));

  EXPECT(PM_OK, pm_scene_resync(scene));
  CHECK(committed(scene, PM_REPORT_CHANGES).is_resync == 1);
  EXPECT(PM_OK, pm_scene_remove(scene, one(7)));
  EXPECT(PM_OK, pm_scene_submit(scene, PM_REPORT_NOTHING));
  EXPECT(PM_OK, pm_scene_drop(scene)); /* while an edit is under way */
}

static void margins(pm_session session) {
  const pm_pair expected = {0, 1};
  const pm_indices both = {.first = 0, .count = 2};
  pm_box boxes[] = {at(0), at(1.25f)};
  const float margin[] = {0.5f, 0.5f}, negative = -1;
  pm_scene_info info = {SIZED(pm_scene_info)};
  pm_scene_options options = {SIZED(pm_scene_options), .margins = 9};
  const pm_pair *found;
  size_t count;
  pm_scene scene;

  EXPECT(PM_ERR_ARGUMENT, pm_scene_create(session, &options, &scene));
  options.margins = PM_MARGINS_EXACT;
  options.usual_margin = -1;
  EXPECT(PM_ERR_MARGINS, pm_scene_create(session, &options, &scene));
  options.usual_margin = 0.5f;
  EXPECT(PM_OK, pm_scene_create(session, &options, &scene));
  for (int step = 0; step < 3; step++) {
    boxes[1] = at(1.25f - 0.2f * (float)step);
    if (step == 0) {
      set(scene, 0, boxes[0]);
      EXPECT(PM_OK, pm_scene_set(scene, 1, &boxes[1], margin));
    } else {
      EXPECT(PM_OK, pm_scene_set_all(scene, both, boxes, 2, margin, 2));
    }
    changes(scene, expected, step == 2 ? 1 : 0, 0, 0);
  }
  EXPECT(PM_OK, pm_scene_get_info(scene, &info));
  CHECK(info.set == 6 && info.sent == 2 && info.edits == 3);
  EXPECT(PM_ERR_MARGINS, pm_scene_set(scene, 0, boxes, &negative));
  EXPECT(PM_OK, pm_scene_set_all(scene, (pm_indices){.count = 3}, boxes, 2, margin, 2));
  EXPECT(PM_ERR_LENGTHS, pm_scene_commit(scene, PM_REPORT_CHANGES, NULL));
  EXPECT(PM_OK, pm_scene_set_all(scene, one(0), boxes, 1, margin, 2));
  EXPECT(PM_ERR_MARGINS, pm_scene_commit(scene, PM_REPORT_CHANGES, NULL));
  /* Queries and rules are of the boxes as they were set. */
  EXPECT(PM_OK, pm_scene_query(scene, &boxes[1], 1, NULL, 0, &found, &count));
  CHECK(count == 2);
  EXPECT(PM_OK, pm_scene_exclude(scene, &expected, 1, true));
  CHECK(committed(scene, PM_REPORT_ALL).pair_count == 0);
  EXPECT(PM_OK, pm_scene_drop(scene));
}

static void shared(pm_session session, bool is_daemon) {
  const pm_pair expected[] = {{3, 4}};
  const pm_box boxes[] = {at(0), at(0.5f)};
  pm_join_options options = {SIZED(pm_join_options), .most_boxes = 100, .all_pairs = 1,
                             .margins = PM_MARGINS_EXACT, .usual_margin = 0.25f};
  pm_scene_info info = {SIZED(pm_scene_info)};
  pm_answer answer;
  pm_range range;
  const pm_pair *found;
  pm_scene scene;
  size_t count;

  if (!is_daemon) {
    EXPECT(PM_ERR_IN_PROCESS, pm_scene_join(session, "arena", NULL, &scene));
    return;
  }
  EXPECT(PM_ERR_SCENE_NAME, pm_scene_join(session, "no such name", NULL, &scene));
  EXPECT(PM_ERR_ARGUMENT, pm_scene_join(session, NULL, NULL, &scene));
  EXPECT(PM_ERR_ARGUMENT, pm_scene_join(session, "arena", &options, &scene));
  options.margins = PM_MARGINS_NEAR;
  EXPECT(PM_OK, pm_scene_join(session, "arena", &options, &scene));
  EXPECT(PM_ERR_LEASE, pm_scene_lease(scene, (pm_range){0, 0}));
  EXPECT(PM_OK, pm_scene_lease(scene, (pm_range){3, 2}));
  EXPECT(PM_OK, pm_scene_lease_any(scene, 3, &range));
  CHECK(range.first == 0 && range.count == 3);
  EXPECT(PM_OK, pm_scene_get_info(scene, &info));
  CHECK(info.most_boxes == 100 && info.tick_deadline_ns > 0);
  CHECK(info.lease_count == 2 && info.leases[0].first == 3 && info.leases[1].count == 3);
  EXPECT(PM_OK, pm_scene_give_back(scene, 0));
  EXPECT(PM_OK, pm_scene_set_all(scene, (pm_indices){.first = 3, .count = 2}, boxes, 2, NULL, 0));
  answer = committed(scene, PM_REPORT_ALL);
  CHECK(answer.tick > 0 && answer.late_count == 0);
  check_pairs(answer.pairs, answer.pair_count, expected, 1);
  set(scene, 50, *boxes);
  EXPECT(PM_ERR_NOT_LEASED, pm_scene_commit(scene, PM_REPORT_CHANGES, NULL));
  set(scene, 3, *boxes);
  answer = committed(scene, PM_REPORT_MOVED);
  check_pairs(answer.pairs, answer.pair_count, expected, 1);
  EXPECT(PM_OK, pm_scene_query(scene, boxes, 1, NULL, 0, &found, &count));
  CHECK(count == 2 && found[0].b == 3 && found[1].b == 4);
  EXPECT(PM_OK, pm_scene_get_info(scene, &info));
  CHECK(info.edits == 2 && info.set == 3 && info.sent == 3);
  EXPECT(PM_OK, pm_scene_drop(scene));
}

static void note(void *user, pm_log_level level, const char *text) {
  CHECK(level >= PM_LOG_ERROR && level <= PM_LOG_INFO && text[0] != 0);
  *(int *)user += 1;
}

int main(int argc, char **argv) {
  const pm_session_options options = options_of(argc, argv);
  const bool is_daemon = options.backend == PM_BACKEND_DAEMON;
  pm_daemon_status status = {SIZED(pm_daemon_status)};
  static int lines = 0;
  pm_session session;

  EXPECT(PM_ERR_ARGUMENT, pm_set_log(NULL, NULL));
  EXPECT(PM_OK, pm_set_log(note, &lines));
  EXPECT(PM_ERR_STATE, pm_set_log(note, &lines));
  EXPECT(PM_OK, pm_session_connect(&options, &session));
  if (is_daemon) {
    EXPECT(PM_OK, pm_session_daemon_status(session, &status));
    CHECK(status.pid != 0 && status.client_count >= 1);
    status.struct_size = 0;
    EXPECT(PM_ERR_ARGUMENT, pm_session_daemon_status(session, &status));
  }
  arguments(session);
  too_many_frames(session);
  frames(session);
  narrow(session);
  rules(session);
  worlds(&options);
  scenes(session);
  margins(session);
  shared(session, is_daemon);
  EXPECT(PM_OK, pm_session_drop(session));
  puts("all calls");
  return 0;
}
