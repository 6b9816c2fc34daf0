// SPDX-License-Identifier: GPL-2.0-or-later
// A TORCS robot that is driven by another process, in lock-step: it says how things are, waits for an order, lets the
// simulation run until the next control step, and so on. Time stands still in between.
//
// The other end is a socket (AF_UNIX, SOCK_SEQPACKET) that this process has inherited. The environment variable
// DPSEARCH_LOCKSTEP holds its number and the options: "fd patience hz base gain rays", see Options. Records are native
// doubles, one a message. From here, once: length of the road, steering lock, mass, wheelbase; then after each order a
// State, but after ROAD the middle line. To here: an Order. If the other end closes, or is silent for too long, TORCS
// exits.
#include <cstdio>
#include <cstdlib>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>
#include <vector>

#include "pedals.hpp"
#include "road.hpp"

extern tRmInfo *ReInfo;  // the race, exported by TORCS' race engine

namespace {

constexpr int RAYS = 9;
constexpr double FARTHEST = 100.0;             // m, of a ray
constexpr double WIDEST = M_PI / 3;            // rad, of the outer rays
constexpr int ROAD_POINTS = 2000;              // so that the middle line fits into one message
constexpr double DROP = 0.02;                  // m above the road, where a car is put
constexpr double SETTLING = 0.3;               // s that it then rolls, besides the time it takes to get going

struct Options {
    int socket = -1;
    double patience = 0;                       // s that the other end may be silent
    double hz = 0;                             // control steps a second
    double base = 0, gain = 0;                 // look-ahead: base + gain * speed
    int rays = 0;                              // whether rays are wanted
} options;

enum Kind { HOLD, PRESS, PUT, ROAD };
struct Order {
    double kind;
    double a;  // HOLD, PRESS: steering in [-1, 1]; PUT: where, in m along the road
    double b;  // HOLD, PUT: target speed in m/s; PRESS: pedal in [-1, 1]
};

struct State {  // dpsearch.envs.torcs.client has the same list
    double time, speed, slip, yaw_rate, x, y, yaw, to_middle, width, steering, along, angle, bearing, curvature;
    double gear, rpm, throttle, brake, mu;
    double rays[RAYS];
};

tTrack *track = nullptr;

[[noreturn]] void leave(const char *why) {
    std::fprintf(stderr, "lockstep: %s\n", why);
    std::fflush(nullptr);
    _exit(17);
}

void send_record(const void *record, size_t size) {
    if (::send(options.socket, record, size, MSG_NOSIGNAL) != static_cast<ssize_t>(size)) leave("the other end is gone");
}

Order next_order() {
    Order order;
    const ssize_t size = ::recv(options.socket, &order, sizeof order, 0);
    if (size == 0) leave("the other end is gone");
    if (size < 0) leave("the other end has been silent for too long");
    if (size != sizeof order) leave("an order of the wrong size");
    return order;
}

void read_options() {
    const char *text = std::getenv("DPSEARCH_LOCKSTEP");
    if (!text || std::sscanf(text, "%d %lf %lf %lf %lf %d", &options.socket, &options.patience, &options.hz,
                             &options.base, &options.gain, &options.rays) != 6)
        leave("DPSEARCH_LOCKSTEP must be: fd patience hz base gain rays");
    timeval patience;
    patience.tv_sec = static_cast<time_t>(options.patience);
    patience.tv_usec = static_cast<suseconds_t>((options.patience - patience.tv_sec) * 1e6);
    if (::setsockopt(options.socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience)) leave("not a socket");
}

class Driver {
  public:
    Driver(tCarElt *car, tSituation *situation) : car_(car), situation_(situation), pedals_(car) {
        const double hello[] = {track->length, car->_steerLock, pedals_.mass(), wheelbase()};
        send_record(hello, sizeof hello);
    }

    // Obeys for ever: `leave` is the only way out.
    [[noreturn]] void obey() {
        for (;;) {
            const Order order = next_order();
            switch (static_cast<int>(order.kind)) {
                case HOLD:
                case PRESS: drive(order); break;
                case PUT: put(order); break;
                case ROAD: send_road(); continue;
                default: leave("an unknown order");
            }
            send_state();
        }
    }

  private:
    void update() {
        car_->_driverType = RM_DRV_HUMAN;  // others are thrown out for being slow
        situation_->currentTime += RCM_MAX_DT_SIMU;
        ReInfo->_reSimItf.update(situation_, RCM_MAX_DT_SIMU, -1);
    }

    // One control step. Its substeps are counted so that rounding does not add up: 17, 17, 16, 17, .. at 30 Hz.
    void drive(const Order &order) {
        const long due = std::lround(++steps_ / (options.hz * RCM_MAX_DT_SIMU));
        car_->_steerCmd = order.a;
        for (; substeps_ < due; ++substeps_) {
            if (order.kind == HOLD) pedals_.hold(order.b, RCM_MAX_DT_SIMU);
            else pedals_.press(order.b);
            update();
        }
    }

    // Puts the car on the road a little before the place, and lets it roll there along the middle line. The simulation
    // is built up anew: nothing of what was before remains.
    void put(const Order &order) {
        const double speed = order.b, start_time = pedals_.start_time(), time = start_time + SETTLING;
        tTrkLocPos place = road::place_at(road::first_segment(track), std::fmod(order.a, track->length) - speed * time);
        std::memset(&car_->pub.DynGC, 0, sizeof car_->pub.DynGC);
        std::memset(&car_->pub.DynGCg, 0, sizeof car_->pub.DynGCg);
        std::memset(&car_->ctrl, 0, sizeof car_->ctrl);
        car_->_trkPos = place;
        RtTrackLocal2Global(&place, &car_->_pos_X, &car_->_pos_Y, TR_TORIGHT);
        car_->_yaw = RtTrackSideTgAngleL(&place);
        NORM0_2PI(car_->_yaw);
        car_->_pos_Z = RtTrackHeightL(&place) + DROP;
        const double thrown = speed * pedals_.spin_up();
        car_->_speed_x = thrown * std::cos(car_->_yaw);  // TORCS takes these for the world's x and y at first, and
        car_->_speed_y = thrown * std::sin(car_->_yaw);  // for the car's from its first substep on
        car_->pub.state = 0;
        car_->_dammage = 0;
        car_->priv.collision = car_->priv.simcollision = 0;
        const tSimItf &sim = ReInfo->_reSimItf;
        sim.shutdown();
        sim.init(situation_->_ncars, track, ReInfo->raceRules.fuelFactor, ReInfo->raceRules.damageFactor);
        sim.config(car_, ReInfo);
        pedals_.reset();
        for (double now = 0.0; now < time; now += RCM_MAX_DT_SIMU) {
            steer_along_middle();
            if (now < start_time) pedals_.roll();
            else pedals_.hold(speed, RCM_MAX_DT_SIMU);
            update();
        }
        steps_ = substeps_ = 0;
    }

    // Towards the middle of the road ahead, on the circle that leads there.
    void steer_along_middle() {
        const double distance = 4.0 + 0.4 * std::max(0.0f, car_->_speed_x);
        const double angle = std::atan(2.0 * wheelbase() * std::sin(bearing(distance)) / distance);
        car_->_steerCmd = std::clamp(angle / car_->_steerLock, -1.0, 1.0);
    }

    double wheelbase() const { return car_->priv.wheel[FRNT_RGT].relPos.x - car_->priv.wheel[REAR_RGT].relPos.x; }

    // The middle of the road so many metres further along it.
    tTrkLocPos ahead(double distance) const {
        return road::place_at(car_->_trkPos.seg, road::into_segment(car_->_trkPos) + distance);
    }

    // Its direction as seen from the car.
    double bearing(double distance) const {
        tTrkLocPos there = ahead(distance);
        tdble x, y;
        RtTrackLocal2Global(&there, &x, &y, TR_TORIGHT);
        return road::wrapped(std::atan2(y - car_->_pos_Y, x - car_->_pos_X) - car_->_yaw);
    }

    void send_state() const {
        tTrkLocPos here = car_->_trkPos;
        const double speed = car_->_speed_x, distance = options.base + options.gain * std::max(0.0, speed);
        const double right = car_->priv.wheel[FRNT_RGT].relPos.az, left = car_->priv.wheel[FRNT_LFT].relPos.az;
        State state{};
        state.time = substeps_ * RCM_MAX_DT_SIMU;
        state.speed = speed;
        state.slip = car_->_speed_y;
        state.yaw_rate = car_->_yaw_rate;
        state.x = car_->_pos_X;
        state.y = car_->_pos_Y;
        state.yaw = car_->_yaw;
        state.to_middle = here.toMiddle;
        state.width = here.seg->width;
        state.steering = (std::fabs(right) > std::fabs(left) ? right : left) / car_->_steerLock;  // the inner wheel
        state.along = road::along(here);
        state.angle = road::wrapped(car_->_yaw - RtTrackSideTgAngleL(&here));
        state.bearing = bearing(distance);
        state.curvature = road::curvature(ahead(distance).seg);
        state.gear = car_->_gear;
        state.rpm = car_->_enginerpm * 30.0 / M_PI;
        state.throttle = car_->_accelCmd;
        state.brake = car_->_brakeCmd;
        state.mu = here.seg->surface->kFriction;
        for (int i = 0; options.rays && i < RAYS; ++i)
            state.rays[i] = road::ray(here, car_->_pos_X, car_->_pos_Y,
                                      car_->_yaw + WIDEST * (2.0 * i / (RAYS - 1) - 1.0), FARTHEST);
        send_record(&state, sizeof state);
    }

    // The middle line: x, y and width, every length / ROAD_POINTS from the start line on.
    void send_road() const {
        std::vector<double> points;
        for (int i = 0; i < ROAD_POINTS; ++i) {
            tTrkLocPos place = road::place_at(road::first_segment(track), track->length * i / ROAD_POINTS);
            tdble x, y;
            RtTrackLocal2Global(&place, &x, &y, TR_TORIGHT);
            points.insert(points.end(), {x, y, place.seg->width});
        }
        send_record(points.data(), points.size() * sizeof(double));
    }

    tCarElt *car_;
    tSituation *situation_;
    Pedals pedals_;
    long steps_ = 0, substeps_ = 0;
};

void new_track(int, tTrack *given, void *, void **settings, tSituation *) {
    track = given;
    *settings = nullptr;
}

void new_race(int, tCarElt *, tSituation *) { read_options(); }

// Called by the race engine every 20 ms of its time, of which there is none once the race has begun: the simulation
// is run from here.
void drive(int, tCarElt *car, tSituation *situation) {
    if (situation->currentTime >= 0.0) Driver(car, situation).obey();
}

int pit_command(int, tCarElt *, tSituation *) { return ROB_PIT_IM; }
void shut_down(int) {}

int offer(int index, void *interface) {
    auto *robot = static_cast<tRobotItf *>(interface);
    robot->rbNewTrack = new_track;
    robot->rbNewRace = new_race;
    robot->rbDrive = drive;
    robot->rbPitCmd = pit_command;
    robot->rbEndRace = nullptr;
    robot->rbShutdown = shut_down;
    robot->index = index;
    return 0;
}

}  // namespace

// What TORCS looks up, under the name of the library.
extern "C" int lockstep(tModInfo *module) {
    module[0].name = strdup("lockstep");
    module[0].desc = strdup("driven by another process, in lock-step");
    module[0].fctInit = offer;
    module[0].gfId = ROB_IDENT;
    module[0].index = 1;
    return 0;
}
