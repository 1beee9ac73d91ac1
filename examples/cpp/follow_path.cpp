// Follows a path of the tip at a fixed rate: one inverse by physics in each cycle.
//
//   follow_path ROBOT.json TIPS.csv [--rate HZ] [--max-tension N] [--out COMMANDS.csv]
//
// ROBOT.json is from `bowstring export ROBOT --out ROBOT.json`. TIPS.csv has the columns tip_x_mm,
// tip_y_mm, tip_z_mm; lines that begin with # are skipped. Where a controller would hand the
// commands to its motors, this program keeps them and writes them at the end.

#include "bowstring.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;
using Tip = std::array<double, 3>;  // m, base frame

struct Free {
    void operator()(BowstringRobot *robot) const { bowstring_robot_free(robot); }
    void operator()(BowstringSolver *solver) const { bowstring_solver_free(solver); }
};
using Robot = std::unique_ptr<BowstringRobot, Free>;
using Solver = std::unique_ptr<BowstringSolver, Free>;

/// What is done in one cycle, and how long it took.
struct Cycle {
    BowstringStatus status;
    BowstringInverse found;
    double seconds;
};

/// A negative status is a wrong call: an error of the program, not of the robot.
void check(BowstringStatus status) {
    if (status < 0) throw std::runtime_error(bowstring_last_error());
}

std::vector<Tip> read_tips(const std::string &path) {
    std::ifstream file(path);
    if (!file) throw std::runtime_error(path + " cannot be read");
    std::vector<Tip> tips;
    std::string line;
    for (bool header = true; std::getline(file, line);) {
        if (line.empty() || line[0] == '#') continue;
        if (header) {
            if (line.rfind("tip_x_mm,tip_y_mm,tip_z_mm", 0) != 0)
                throw std::runtime_error(path + ": the columns must be tip_x_mm,tip_y_mm,tip_z_mm");
            header = false;
            continue;
        }
        std::istringstream cells(line);
        Tip tip;
        for (double &x : tip) {
            std::string cell;
            std::getline(cells, cell, ',');
            char *end = nullptr;
            x = 1e-3 * std::strtod(cell.c_str(), &end);
            if (end == cell.c_str())
                throw std::runtime_error(path + ": " + line + " has no three numbers");
        }
        tips.push_back(tip);
    }
    if (tips.empty()) throw std::runtime_error(path + " has no tips");
    return tips;
}

void write_commands(const std::string &path, const std::vector<double> &tensions,
                    const std::vector<double> &displacements, std::size_t tendons) {
    std::ofstream file(path);
    file.precision(12);
    for (std::size_t i = 0; i < tendons; ++i) file << (i ? "," : "") << "tension_" << i + 1 << "_N";
    for (std::size_t i = 0; i < tendons; ++i) file << ",displacement_" << i + 1 << "_mm";
    file << '\n';
    for (std::size_t row = 0; row < tensions.size(); row += tendons) {
        for (std::size_t i = 0; i < tendons; ++i) file << (i ? "," : "") << tensions[row + i];
        for (std::size_t i = 0; i < tendons; ++i) file << ',' << 1e3 * displacements[row + i];
        file << '\n';
    }
    if (!file) throw std::runtime_error(path + " cannot be written");
}

void report(const std::vector<Cycle> &cycles, double period) {
    std::vector<double> times;
    double farthest = 0.0;
    int reached = 0, restarted = 0, late = 0;
    for (const Cycle &cycle : cycles) {
        times.push_back(1e3 * cycle.seconds);
        reached += cycle.status == BOWSTRING_STATUS_OK;
        restarted += cycle.found.restarted;
        late += cycle.seconds > period;
        farthest = std::max(farthest, cycle.found.distance_m);
    }
    std::sort(times.begin(), times.end());
    const auto at = [&](double share) { return times[std::size_t(share * (times.size() - 1))]; };
    std::printf("step: median %.4f ms, p99 %.4f ms, largest %.4f ms; %d of %zu longer than a cycle\n",
                at(0.5), at(0.99), times.back(), late, times.size());
    std::printf("tip: %d of %zu reached, at most %.3g mm from the path; %d from another start\n",
                reached, cycles.size(), 1e3 * farthest, restarted);
}

int run(int argc, char **argv) {
    std::string out;
    double rate = 1000.0, most = 0.0;
    if (argc < 3) throw std::runtime_error("give a robot and a table of tips");
    for (int i = 3; i < argc; i += 2) {
        const std::string flag = argv[i];
        if (i + 1 == argc) throw std::runtime_error(flag + " needs a value");
        if (flag == "--out") out = argv[i + 1];
        else if (flag == "--rate") rate = std::strtod(argv[i + 1], nullptr);
        else if (flag == "--max-tension") most = std::strtod(argv[i + 1], nullptr);
        else throw std::runtime_error("no flag " + flag);
    }
    if (!(rate > 0.0)) throw std::runtime_error("--rate must be positive, in Hz");

    // before the loop: all that reads files and takes memory
    const std::vector<Tip> tips = read_tips(argv[2]);
    const Robot robot(bowstring_robot_from_file(argv[1]));
    if (!robot) throw std::runtime_error(bowstring_last_error());
    const Solver solver(bowstring_solver_new(robot.get(), nullptr));
    if (!solver) throw std::runtime_error(bowstring_last_error());
    const std::size_t n = bowstring_robot_tendon_count(robot.get());
    if (most > 0.0) {
        const std::vector<double> limits(n, most);
        check(bowstring_set_limits(solver.get(), nullptr, limits.data(), n));
    }
    std::vector<double> tensions(n * tips.size()), displacements(n * tips.size());
    std::vector<Cycle> cycles(tips.size());

    // the first target has no last one to start from; it is solved here, not in the loop
    check(bowstring_inverse(solver.get(), tips[0].data(), nullptr, nullptr, tensions.data(), n,
                            nullptr));

    const std::chrono::duration<double> period(1.0 / rate);
    auto next = Clock::now();
    for (std::size_t k = 0; k < tips.size(); ++k) {
        std::this_thread::sleep_until(next);
        next += std::chrono::duration_cast<Clock::duration>(period);
        const auto start = Clock::now();
        Cycle &cycle = cycles[k];
        cycle.status = bowstring_inverse(solver.get(), tips[k].data(), nullptr, nullptr,
                                         &tensions[n * k], n, &cycle.found);
        check(cycle.status);
        if (cycle.status != BOWSTRING_STATUS_NO_EQUILIBRIUM)
            check(bowstring_displacements(solver.get(), &displacements[n * k], n));
        cycle.seconds = std::chrono::duration<double>(Clock::now() - start).count();
        // here the motors take the tensions or displacements of this cycle
    }

    std::printf("%zu tips at %g Hz, %zu tendons, bowstring %s\n", tips.size(), rate, n,
                bowstring_version());
    report(cycles, period.count());
    if (!out.empty()) write_commands(out, tensions, displacements, n);
    return 0;
}

}  // namespace

int main(int argc, char **argv) {
    try {
        return run(argc, argv);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "Error: %s\n", error.what());
        return 2;
    }
}
