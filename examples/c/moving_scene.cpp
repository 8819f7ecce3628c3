// A persistent scene: a box moves along a row of others, and the scene reports which pairs begin and end.
#include <pairmask.hpp>

#include <cstdio>
#include <vector>

int main() {
  auto session = pairmask::Session::connect().value();
  auto scene = session.scene().value();

  // Ten boxes in a row, which stay where they are, and one that moves.
  std::vector<pairmask::Box> row;
  for (int i = 0; i < 10; i++) {
    const float x = 2.0f * static_cast<float>(i);
    row.push_back(pairmask::box(x, 0, 0, x + 1, 1, 1));
  }
  scene.set_all(pairmask::range(0, row.size()), row).value();

  unsigned begun = 0, ended = 0;
  for (int step = 0; step < 100; step++) {
    const float x = 0.25f * static_cast<float>(step) - 1.5f;
    scene.set(10, pairmask::box(x, 0, 0, x + 1, 1, 1)).value();
    const auto answer = scene.commit(PM_REPORT_CHANGES).value();
    for (const auto [a, b] : answer.begun()) {
      std::printf("step %d: %u and %u meet\n", step, a, b);
      begun += 1;
    }
    for (const auto &pair : answer.ended()) {
      std::printf("step %d: %u and %u part\n", step, pair.a, pair.b);
      ended += 1;
    }
  }
  std::printf("%u pairs began, %u ended\n", begun, ended);
  return begun == 10 && ended == 10 ? 0 : 1;
}
