// Runs an exported agent with libtorch: no Python, no dntorch.
//
//   run_agent DIR [SECONDS]
//
// Replays the golden record of DIR through agent.ts, then runs the agent as fast as it goes and at
// its control rate, and reports latencies. The exit code is 1 if the replay differs. A robot of
// your own takes the place of the recorded frames in `control`. For steady latencies on a machine
// that has more to do, give it real-time priority: chrt -f 10 run_agent DIR.

#include <ATen/Parallel.h>
#include <torch/csrc/jit/serialization/import.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <limits>
#include <thread>

#include "npz.hpp"

using torch::Tensor;
using State = c10::Dict<std::string, Tensor>;
using Clock = std::chrono::steady_clock;

constexpr double STEP = 1e-6, FREE = 1e-4;  // tolerances: one step, and long-term memory
const std::string LEARNING = "learner.values.learning", WEIGHTS = "learner.values.weights";

// One part of the golden record: "run", a continuous run, or "pairs", steps from given states.
struct Record {
  npz::Arrays arrays;
  std::string part;

  bool has(const std::string& name) const { return arrays.count(part + "/" + name) > 0; }
  Tensor all(const std::string& name) const {
    if (!has(name)) throw std::runtime_error("the golden record lacks " + name + ": export again");
    return arrays.at(part + "/" + name);
  }
  Tensor at(const std::string& name, int64_t step) const { return all(name)[step]; }
  int64_t steps() const { return all("action").size(0); }

  // Tensors of the state at a step; prefix "state." before it, "next." after it.
  std::map<std::string, Tensor> state(const std::string& prefix, int64_t step) const {
    std::map<std::string, Tensor> found;
    const std::string start = part + "/" + prefix;
    for (const auto& [name, array] : arrays)
      if (name.rfind(start, 0) == 0) found[name.substr(start.size())] = array[step];
    return found;
  }
};

struct Agent {
  torch::jit::Module module;
  double dt;

  explicit Agent(const std::string& path) : module(torch::jit::load(path)) {
    module.eval();
    dt = module.attr("dt").toDouble();
  }
  Tensor step(const Tensor& image, const Tensor& reward, const Tensor& noise) {
    return module.forward({image, reward, noise}).toTensor();
  }
  Tensor step(const Record& record, int64_t k) {
    learn(record.at(LEARNING, k).item<float>() > 0);
    return step(record.at("image", k), record.at("reward", k), record.at("noise", k));
  }
  void learn(bool on) {
    if (on != learning) module.run_method("learn", on);
    learning = on;
  }
  void reset() { module.run_method("reset"); }
  State state() {
    return c10::impl::toTypedDict<std::string, Tensor>(
        module.run_method("get_state").toGenericDict());
  }
  void set(const std::map<std::string, Tensor>& values) {
    State state;
    for (const auto& [name, value] : values) state.insert(name, value);
    module.run_method("set_state", state);
  }

 private:
  bool learning = true;
};

double difference(const Tensor& actual, const Tensor& expected) {
  if (!actual.sizes().equals(expected.sizes())) return std::numeric_limits<double>::infinity();
  const Tensor gap = (actual.to(torch::kFloat64) - expected.to(torch::kFloat64)).abs() /
                     expected.to(torch::kFloat64).abs().clamp_min(1);
  const double largest = gap.numel() ? gap.max().item<double>() : 0;
  return std::isnan(largest) ? std::numeric_limits<double>::infinity() : largest;
}

// Compares what the agent does with the record; returns whether it is the same.
bool replay(Agent& agent, const Record& run, const Record& pairs) {
  double motion = 0, weights = 0;
  int64_t undecided = 0;
  for (int64_t k = 0; k < run.steps(); ++k) {
    motion = std::max(motion, difference(agent.step(run, k), run.at("action", k)));
    const State state = agent.state();
    weights = std::max(weights, difference(state.at(WEIGHTS), run.at("next." + WEIGHTS, k)));
    undecided += !state.at("decisions").equal(run.at("next.decisions", k));
  }
  double action = 0, state = 0;
  for (int64_t k = 0; k < pairs.steps(); ++k) {
    agent.set(pairs.state("state.", k));
    action = std::max(action, difference(agent.step(pairs, k), pairs.at("action", k)));
    const State after = agent.state();
    for (const auto& [name, expected] : pairs.state("next.", k))
      state = std::max(state, difference(after.at(name), expected));
  }
  const bool same = action <= STEP && state <= STEP && weights <= FREE && undecided == 0;
  std::printf("step by step, %lld steps: action %.1e, state %.1e\n",
              static_cast<long long>(pairs.steps()), action, state);
  std::printf("freely, %lld steps: action %.1e, weights %.1e, other decisions in %lld steps\n",
              static_cast<long long>(run.steps()), motion, weights,
              static_cast<long long>(undecided));
  std::printf("replay: %s\n", same ? "ok" : "FAILED");
  return same;
}

std::string summary(std::vector<double> milliseconds) {
  std::sort(milliseconds.begin(), milliseconds.end());
  const auto at = [&](double share) {
    return milliseconds[static_cast<size_t>(share * (milliseconds.size() - 1))];
  };
  char text[100];
  std::snprintf(text, sizeof text, "latency median %.3f ms, p99 %.3f ms, worst %.3f ms", at(0.5),
                at(0.99), at(1));
  return text;
}

// One control step, frame in, wheel speeds out, and how many milliseconds it took.
double control(Agent& agent, const Record& run, int64_t k) {
  const int64_t row = k % run.steps();
  const Tensor image = run.at("image", row);  // a camera goes here
  const Tensor reward = run.at("reward", row), noise = torch::zeros_like(run.at("noise", row));
  const auto began = Clock::now();
  const Tensor wheels = agent.step(image, reward, noise);
  const double taken = std::chrono::duration<double, std::milli>(Clock::now() - began).count();
  static_cast<void>(wheels);  // motors go here
  return taken;
}

// As fast as it goes: the caches stay warm.
void race(Agent& agent, const Record& run) {
  std::vector<double> latencies;
  agent.reset();
  for (int64_t k = 0; k < run.steps(); ++k) latencies.push_back(control(agent, run, k));
  std::printf("in one go: %lld steps, %s\n", static_cast<long long>(run.steps()),
              summary(latencies).c_str());
}

// The loop of a robot at a fixed rate.
void drive(Agent& agent, const Record& run, double seconds) {
  const auto period = std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(agent.dt));
  const int64_t steps = std::max<int64_t>(1, static_cast<int64_t>(seconds / agent.dt));
  std::vector<double> latencies;
  int64_t missed = 0;
  agent.reset();
  auto due = Clock::now();
  for (int64_t k = 0; k < steps; ++k) {
    latencies.push_back(control(agent, run, k));
    due += period;
    if (Clock::now() > due) {
      ++missed;
      due = Clock::now();  // go on from here, do not hurry after what is lost
    }
    std::this_thread::sleep_until(due);
  }
  std::printf("loop: %lld steps at %.0f Hz, %s, missed deadlines %lld\n",
              static_cast<long long>(steps), 1 / agent.dt, summary(latencies).c_str(),
              static_cast<long long>(missed));
}

int fail(const std::string& reason) {
  std::cerr << "run_agent: " << reason << "\n";
  return 1;
}

int main(int count, char** arguments) {
  if (count < 2 || count > 3) {
    std::cerr << "usage: run_agent DIR [SECONDS]\n";
    return 2;
  }
  const std::string folder = arguments[1];
  try {
    const double seconds = count > 2 ? std::stod(arguments[2]) : 10;
    at::set_num_threads(1);
    at::globalContext().setFlushDenormal(true);
    c10::InferenceMode inference;
    Agent agent(folder + "/agent.ts");
    const npz::Arrays golden = npz::load(folder + "/golden.npz");
    const Record run{golden, "run"}, pairs{golden, "pairs"};
    const bool same = replay(agent, run, pairs);
    race(agent, run);
    drive(agent, run, seconds);
    return same ? 0 : 1;
  } catch (const c10::Error& error) {
    const std::string text = error.what_without_backtrace();
    return fail(text.substr(0, text.find('\n')));
  } catch (const std::exception& error) {
    // What a TorchScript method raises stands in the last line.
    std::string text = error.what();
    while (!text.empty() && text.back() == '\n') text.pop_back();
    return fail(text.substr(text.rfind('\n') + 1));
  }
}
