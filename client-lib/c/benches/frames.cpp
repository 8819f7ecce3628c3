// As frames.c, through the interface of C++.
#include "pairmask.hpp"

#include <chrono>
#include <cinttypes>
#include <cstring>

int main(int argc, char **argv) {
  static pairmask::Box given[1000];
  std::FILE *file = argc == 2 ? std::fopen(argv[1], "rb") : nullptr;
  if (file == nullptr || std::fread(given, sizeof *given, 1000, file) != 1000) {
    return 2;
  }
  pairmask::SessionOptions options;
  options.backend = PM_BACKEND_IN_PROCESS;
  options.no_repeats = 1;
  options.threads = 1;
  auto session = pairmask::Session::connect(options).value();
  unsigned long frames = 0;
  while (std::scanf("%lu", &frames) == 1) {
    std::uint64_t sum = 0;
    const auto start = std::chrono::steady_clock::now();
    for (unsigned long i = 0; i < frames; i++) {
      auto frame = session.frame(1000).value();
      std::memcpy(frame.boxes().data(), given, sizeof given);
      auto mask = std::move(frame).submit().value().wait().value();
      mask.for_each([&](pairmask::Span<const pairmask::Pair> pairs) {
            for (const auto [a, b] : pairs) {
              sum += a ^ b;
            }
          })
          .value();
    }
    const std::chrono::duration<double, std::nano> taken = std::chrono::steady_clock::now() - start;
    std::printf("%.1f %" PRIu64 "\n", taken.count() / static_cast<double>(frames), sum / frames);
    std::fflush(stdout);
  }
  return 0;
}
