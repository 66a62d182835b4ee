/* The simulator's scheme for one machine in plain C: the row that says what a compiled language reaches.
 *
 * See models/simulator.py for the scheme and models/kernel.py for the names; signals are arrays of n doubles. Damped
 * elements are left out: the job has none, and twin.py refuses a machine with any. The compiler may contract a * b + c
 * into one rounding, as it does by default, so that the last digits differ from the simulator's.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

#define MODES 8
#define ELEMENTS 64
#define STATES 16

typedef struct {
    double sample_time, thrust_limit, resolution, offset, start;
    double kp, ki, kd, tau;
    double step[2];              /* [s], before and after the thrust changes in a sample */
    double phi[2][MODES][4];     /* transition of (q, q') over a substep */
    double gamma[2][MODES][2];   /* effect of the held input on (q, q') */
    double stiffness[ELEMENTS], limit[ELEMENTS], z[ELEMENTS];
    double a[STATES][STATES], b[STATES][2], c[STATES], d[2], hold[STATES], reset[STATES]; /* a law, models/feedback */
    int64_t counts[2], delay, reference_delay, modes, elements;
    int64_t states, keeps_to_the_rating; /* without states there is no law: the PID runs */
} Machine;

static double clipped(double number, double limit) {
    return number < -limit ? -limit : number > limit ? limit : number;
}

static double quantised(double position, double resolution) {
    return resolution == 0.0 ? position : floor(position / resolution + 0.5) * resolution;
}

static double law_step(const Machine *m, double *state, double reference, double reading, double feedforward) {
    double next[STATES], wanted = m->d[0] * reference + m->d[1] * reading;
    for (int i = 0; i < m->states; i++) wanted += m->c[i] * state[i];
    wanted += feedforward;
    const double command = m->keeps_to_the_rating ? clipped(wanted, m->thrust_limit) : wanted;
    for (int i = 0; i < m->states; i++) {
        next[i] = m->b[i][0] * reference + m->b[i][1] * reading + m->reset[i] * (command - wanted);
        for (int j = 0; j < m->states; j++) next[i] += m->a[i][j] * state[j];
    }
    for (int i = 0; i < m->states; i++) state[i] = next[i];
    return command;
}

void twin(const Machine *machine, size_t n, const double *reference, const double *feedforward, const double *noise,
          double *reading, double *command, double *position, double *friction) {
    const Machine m = *machine; /* a copy no signal can alias */
    double z[ELEMENTS], q[MODES] = {0}, rate[MODES] = {0};
    double x = 0, v = 0, at = 0, integral = m.start, slope = 0, previous = 0;
    const double keep = m.tau / (m.tau + m.sample_time);

    double state[STATES];

    for (int i = 0; i < m.elements; i++) z[i] = m.z[i];
    for (int i = 0; i < m.states; i++) state[i] = m.hold[i] * m.start;
    for (size_t k = 0; k < n; k++) {
        double force = 0;
        for (int i = 0; i < m.elements; i++) force += m.stiffness[i] * clipped(z[i] + (x - at), m.limit[i]);
        position[k] = x;
        friction[k] = force;
        reading[k] = quantised(x + noise[k], m.resolution);

        size_t waited = k >= (size_t)m.reference_delay ? k - (size_t)m.reference_delay : 0;
        if (m.states > 0) {
            command[k] = law_step(&m, state, reference[waited], reading[k], feedforward[k]);
        } else {
            double error = reference[waited] - reading[k];
            integral += m.ki * m.sample_time * error;
            slope = keep * slope + (1 - keep) * (error - previous) / m.sample_time;
            previous = error;
            command[k] = m.kp * error + integral + m.kd * slope + feedforward[k];
        }

        for (int part = 0; part < 2; part++) {
            int64_t sent = (int64_t)k - m.delay - 1 + part;
            double thrust = clipped(sent >= 0 ? command[sent] : m.start, m.thrust_limit) - m.offset;
            for (int64_t s = 0; s < m.counts[part]; s++) {
                double middle = x + 0.5 * m.step[part] * v, moved = middle - at;
                at = middle;
                force = 0;
                for (int i = 0; i < m.elements; i++) {
                    z[i] = clipped(z[i] + moved, m.limit[i]);
                    force += m.stiffness[i] * z[i];
                }
                double net = thrust - force;
                x = v = 0;
                for (int j = 0; j < m.modes; j++) {
                    const double *phi = m.phi[part][j], *gamma = m.gamma[part][j];
                    double before = q[j];
                    q[j] = phi[0] * before + phi[1] * rate[j] + gamma[0] * net;
                    rate[j] = phi[2] * before + phi[3] * rate[j] + gamma[1] * net;
                    x += q[j];
                    v += rate[j];
                }
            }
        }
    }
}
