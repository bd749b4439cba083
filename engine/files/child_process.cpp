#include "engine/files/child_process.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <sstream>

#include "engine/base/error.hpp"
#include "engine/base/format.hpp"
#include "engine/files/text_file.hpp"
namespace trocar {
namespace {

constexpr size_t kErrorTail = 4096;
constexpr size_t kPipeBytes = size_t{1} << 20;

// Two ends of a pipe, closed by the destructor.
struct Pipe {
    int read_end = -1, write_end = -1;
    ~Pipe() {
        close_end(read_end);
        close_end(write_end);
    }
    static void close_end(int& fd) {
        if (fd >= 0) ::close(fd);
        fd = -1;
    }
};

[[noreturn]] void fail(const std::string& program, int fault) { throw InputError(program + ": cannot start: " + std::strerror(fault)); }

void open_pipe(Pipe& pipe, const std::string& program) {
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) fail(program, errno);
    pipe.read_end = ends[0];
    pipe.write_end = ends[1];
}

// A file in memory with the content `bytes`, positioned at its start.
int open_memory_file(std::string_view bytes, const std::string& program) {
    const int fd = ::memfd_create("input", MFD_CLOEXEC);
    if (fd < 0) fail(program, errno);
    size_t done = 0;
    while (done < bytes.size()) {
        const ssize_t got = ::pwrite(fd, bytes.data() + done, std::min(bytes.size() - done, size_t{1} << 30), static_cast<off_t>(done));
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) {
            const int fault = errno;
            ::close(fd);
            fail(program, fault);
        }
        done += static_cast<size_t>(got);
    }
    return fd;
}

// A child process; the destructor kills it and waits for it if that was not done.
struct Child {
    pid_t pid = -1;
    ~Child() {
        if (pid < 0) return;
        ::kill(-pid, SIGKILL);
        ::kill(pid, SIGKILL);
        while (::waitpid(pid, nullptr, 0) < 0 && errno == EINTR) {
        }
    }
};

void limit(int resource, uint64_t soft, uint64_t hard) {
    const rlimit value{static_cast<rlim_t>(soft), static_cast<rlim_t>(hard)};
    ::setrlimit(static_cast<__rlimit_resource>(resource), &value);
}

// Between fork and exec only calls that are safe in a signal handler are allowed: no allocation, no throw.
[[noreturn]] void become(char* const* arguments, const ChildLimits& limits, int input, int output, int errors, int report, pid_t parent) {
    ::setpgid(0, 0);
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(127);
    sigset_t none;
    sigemptyset(&none);
    ::sigprocmask(SIG_SETMASK, &none, nullptr);
    for (const int signal : {SIGPIPE, SIGXCPU, SIGXFSZ, SIGINT, SIGTERM, SIGHUP}) ::signal(signal, SIG_DFL);
    limit(RLIMIT_CORE, 0, 0);
    if (limits.cpu_seconds > 0) {
        const uint64_t seconds = static_cast<uint64_t>(std::ceil(limits.cpu_seconds));
        limit(RLIMIT_CPU, seconds, seconds + 1);  // terminated by SIGXCPU, then killed
    }
    if (limits.address_space_bytes > 0) limit(RLIMIT_AS, limits.address_space_bytes, limits.address_space_bytes);
    ::dup2(input, STDIN_FILENO);
    ::dup2(output, STDOUT_FILENO);
    ::dup2(errors, STDERR_FILENO);
    ::close_range(STDERR_FILENO + 1, ~0u, CLOSE_RANGE_CLOEXEC);
    ::execv(arguments[0], arguments);
    const int fault = errno;
    const ssize_t ignored = ::write(report, &fault, sizeof fault);
    (void)ignored;
    ::_exit(127);
}

// Starts the child; returns after a successful exec, else throws.
void start(Child& child, const std::vector<std::string>& arguments, const ChildLimits& limits, std::string_view text, Pipe& output,
           Pipe& errors) {
    const std::string& program = arguments.front();
    std::vector<char*> pointers;
    for (const std::string& argument : arguments) pointers.push_back(const_cast<char*>(argument.c_str()));
    pointers.push_back(nullptr);
    Pipe report, input;
    open_pipe(output, program);
    open_pipe(errors, program);
    open_pipe(report, program);
    input.read_end = open_memory_file(text, program);
    // descriptors below 3 would be overwritten while the child sets up its own
    for (int* fd : {&output.write_end, &errors.write_end, &report.write_end, &input.read_end}) {
        const int high = *fd > STDERR_FILENO ? *fd : ::fcntl(*fd, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
        if (high < 0) fail(program, errno);
        if (high != *fd) ::close(*fd);
        *fd = high;
    }
    ::fcntl(output.read_end, F_SETPIPE_SZ, kPipeBytes);  // fewer reads; the default size works too
    const pid_t parent = ::getpid();
    child.pid = ::fork();
    if (child.pid < 0) fail(program, errno);
    if (child.pid == 0) {
        become(pointers.data(), limits, input.read_end, output.write_end, errors.write_end, report.write_end, parent);
    }
    ::setpgid(child.pid, child.pid);  // by parent and child, so that it is set whichever runs first
    Pipe::close_end(output.write_end);
    Pipe::close_end(errors.write_end);
    Pipe::close_end(report.write_end);
    int fault = 0;
    ssize_t got = 0;
    do got = ::read(report.read_end, &fault, sizeof fault);
    while (got < 0 && errno == EINTR);
    if (got == static_cast<ssize_t>(sizeof fault)) fail(program, fault);
}

// Reads the available bytes. False at the end of the stream.
bool take(int fd, std::string& text) {
    char buffer[1 << 16];
    const ssize_t got = ::read(fd, buffer, sizeof buffer);
    if (got > 0) text.append(buffer, static_cast<size_t>(got));
    return got > 0 || (got < 0 && (errno == EINTR || errno == EAGAIN));
}

void keep_tail(std::string& text) {
    if (text.size() > 2 * kErrorTail) text.erase(0, text.size() - kErrorTail);
}

bool has_ended(pid_t pid) {
    siginfo_t info{};
    return ::waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid == pid;
}

// Collects until the child ends (a grandchild may keep the pipes open longer) or hits a limit.
ChildEnd collect(pid_t pid, const ChildLimits& limits, Pipe& output, Pipe& errors, ChildResult& result) {
    using Clock = std::chrono::steady_clock;
    const Clock::time_point start = Clock::now();
    ::fcntl(output.read_end, F_SETFL, O_NONBLOCK);
    ::fcntl(errors.read_end, F_SETFL, O_NONBLOCK);
    while (true) {
        const bool ended = has_ended(pid);  // checked first: all its output is then in the pipes
        pollfd streams[] = {{output.read_end, POLLIN, 0}, {errors.read_end, POLLIN, 0}};
        const bool open = output.read_end >= 0 || errors.read_end >= 0;
        const int ready = ::poll(streams, 2, ended ? 0 : open ? 10 : 1);
        if (ready > 0 && streams[0].revents != 0 && !take(output.read_end, result.output)) {
            Pipe::close_end(output.read_end);
        }
        if (ready > 0 && streams[1].revents != 0 && !take(errors.read_end, result.last_errors)) {
            Pipe::close_end(errors.read_end);
        }
        keep_tail(result.last_errors);
        if (limits.output_bytes > 0 && result.output.size() > limits.output_bytes) {
            result.output.resize(limits.output_bytes);
            return ChildEnd::kOutputLimit;
        }
        if (ended && ready <= 0) return ChildEnd::kExited;
        const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
        if (limits.wall_seconds > 0 && seconds > limits.wall_seconds) return ChildEnd::kWallLimit;
        if (limits.stop && limits.stop()) return ChildEnd::kStopped;
    }
}

}  // namespace

ChildResult run_child(const std::vector<std::string>& arguments, const ChildLimits& limits, std::string_view input) {
    if (arguments.empty()) throw InputError("no program to start");
    ChildResult result;
    Pipe output, errors;
    Child child;
    start(child, arguments, limits, input, output, errors);
    result.end = collect(child.pid, limits, output, errors, result);
    // before waiting for it: until then the group number cannot be reused
    ::kill(-child.pid, SIGKILL);
    int status = 0;
    rusage usage{};
    while (::wait4(child.pid, &status, 0, &usage) < 0 && errno == EINTR) {
    }
    child.pid = -1;
    const auto seconds = [](const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec); };
    result.cpu_seconds = seconds(usage.ru_utime) + seconds(usage.ru_stime);
    result.peak_resident_bytes = static_cast<uint64_t>(usage.ru_maxrss) * 1024;
    if (result.end != ChildEnd::kExited) return result;
    if (WIFEXITED(status)) {
        result.exit_code = WEXITSTATUS(status);
    } else {
        result.signal = WTERMSIG(status);
        const bool out_of_time = limits.cpu_seconds > 0 && result.cpu_seconds >= std::ceil(limits.cpu_seconds);
        const bool by_limit = result.signal == SIGXCPU || (result.signal == SIGKILL && out_of_time);
        result.end = by_limit ? ChildEnd::kCpuLimit : ChildEnd::kSignal;
    }
    return result;
}

std::string last_error_line(const ChildResult& result) {
    const std::string& errors = result.last_errors;
    const size_t stop = errors.find_last_not_of(" \t\r\n");
    if (stop == std::string::npos) return "";
    const size_t before = errors.find_last_of("\r\n", stop);
    const size_t start = before == std::string::npos ? 0 : before + 1;
    std::string line = errors.substr(start, std::min<size_t>(stop + 1 - start, 300));
    for (char& c : line) c = static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? ' ' : c;
    return line;
}

std::string describe_child_end(const ChildResult& result, const ChildLimits& limits) {
    const std::string line = last_error_line(result);
    switch (result.end) {
        case ChildEnd::kExited:
            if (result.exit_code == 0) return "";
            if (result.exit_code == kChildOutOfMemory && limits.address_space_bytes > 0) {
                return "ran out of its " + describe_bytes(limits.address_space_bytes) + " of memory";
            }
            return "ended with code " + std::to_string(result.exit_code) + (line.empty() ? "" : ": " + line);
        case ChildEnd::kSignal:
            return std::string("crashed (") + ::strsignal(result.signal) + ")" + (line.empty() ? "" : ": " + line);
        case ChildEnd::kCpuLimit:
            return "was stopped after " + format("%g s", std::ceil(limits.cpu_seconds)) + " of processor time";
        case ChildEnd::kWallLimit:
            return "was stopped after " + format("%g s", limits.wall_seconds);
        case ChildEnd::kOutputLimit:
            return "was stopped after an answer of " + describe_bytes(limits.output_bytes);
        case ChildEnd::kStopped:
            return "was stopped";
    }
    return "";
}

std::filesystem::path find_helper_program(const std::string& name) {
    namespace fs = std::filesystem;
    std::error_code ignored;
    std::vector<fs::path> folders;
    if (const char* named = std::getenv("TROCAR_LIBEXEC"); named && *named) folders.emplace_back(named);
    const fs::path self = fs::read_symlink("/proc/self/exe", ignored);
    if (!self.empty()) {
        folders.push_back(self.parent_path());
        folders.push_back(self.parent_path().parent_path() / "libexec" / "trocar");
    }
    folders.emplace_back(TROCAR_LIBEXEC_FOLDER);
    for (const fs::path& folder : folders) {
        const fs::path program = folder / name;
        if (fs::is_regular_file(program, ignored) && ::access(program.c_str(), X_OK) == 0) return fs::absolute(program);
    }
    return {};
}

std::string find_on_path(const std::string& name) {
    const char* path = std::getenv("PATH");
    std::istringstream folders(path ? path : "/usr/bin:/bin");
    for (std::string folder; std::getline(folders, folder, ':');)
        if (const auto program = std::filesystem::path(folder) / name; ::access(program.c_str(), X_OK) == 0) return program.string();
    return {};
}

uint64_t helper_address_space(uint64_t bytes) {
#ifdef __SANITIZE_ADDRESS__
    return bytes * 0;
#else
    return bytes;
#endif
}

}  // namespace trocar
