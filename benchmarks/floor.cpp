// The step of the agent without senses, one struct per agent, float32: the floor of core.py.
#include <cmath>
static inline float f(float u) { float x = 100 * u; return 0.5f + 0.5f * x / (1 + std::fabs(x)); }
struct Agent { float ui[4], uc[4], val[4], pulse[16], inhib[16], trace[16], opp[16], err, w[16]; };
static void one_step(Agent* agents, const float* match, const float* reward, const float* noise,
                     int batch, const float* base) {
  const float dt = 1 / 32.f;
  for (int b = 0; b < batch; b++) {
    Agent& a = agents[b];
    const float *m = match + 4 * b, *q = noise + 4 * b;
    float fi[4], fc[4], on[4], x[4], si = 0, sc = 0, best = 1e-9f, drive[16], total = 0, sum = 0;
    for (int i = 0; i < 4; i++) {
      si += fi[i] = f(a.ui[i]); sc += fc[i] = f(a.uc[i]); on[i] = fc[i] > 0.5f;
    }
    for (int i = 0; i < 4; i++) {
      float y = q[i];
      for (int j = 0; j < 4; j++) y += a.w[4 * i + j] * on[j];
      x[i] = (std::fmax(y, 0.f) + base[i]) * (1 - on[i]); best = std::fmax(best, x[i]);
    }
    for (int i = 0; i < 4; i++) {
      float di = 10 * a.val[i] - 20 * fc[i], dc = 15 * m[i] - 2 * (si - fi[i]);
      a.ui[i] += dt / 0.3f * (-a.ui[i] - 5 + 10 * fi[i] - 30 * (si - fi[i]) + di);
      a.uc[i] += dt / 0.3f * (-a.uc[i] - 5 + 8 * fc[i] - 8 * (sc - fc[i]) + dc);
      a.ui[i] = std::fmax(a.ui[i], -12.f);
      float y = x[i] / best; y *= y; y *= y; y *= y;
      a.val[i] += dt / 0.1f * (y - a.val[i]);
    }
    for (int k = 0; k < 16; k++) {
      total += drive[k] = 1.1f * (a.pulse[k] > 0.05f ? a.pulse[k] : 0) + 0.8f * a.trace[k];
      sum += a.opp[k];
    }
    float signal = 0.06f * (reward[b] + a.err);
    for (int i = 0; i < 4; i++) for (int j = 0; j < 4; j++) {
      int k = 4 * i + j;
      float active = i != j && fi[i] * fc[j] > 0.5f, p = a.pulse[k];
      float gated = a.trace[k] > 0.01f ? a.w[k] : 0;
      float input = gated * (0.8f * (p > 0.05f) - (p < -0.05f));
      a.pulse[k] += dt / 0.5f * (active - p - a.inhib[k]);
      a.inhib[k] += dt / 0.5f * (active - a.inhib[k]);
      a.opp[k] += dt / 0.1f * (input - a.opp[k]);
      a.w[k] += dt * (1 - active) * a.trace[k] * signal;
      a.trace[k] += dt * (drive[k] - a.trace[k] * total);
    }
    a.err += dt / 0.1f * (sum - a.err);
  }
}

// A portion of steps: match[steps][batch][4], reward[steps][batch].
extern "C" void run(Agent* agents, const float* match, const float* reward, const float* noise,
                    int batch, const float* base, int steps) {
  for (long t = 0; t < steps; t++)
    one_step(agents, match + 4 * batch * t, reward + batch * t, noise, batch, base);
}
