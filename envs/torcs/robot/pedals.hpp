// SPDX-License-Identifier: GPL-2.0-or-later
// Throttle, brake and gears: a driver who holds a speed, and an automatic gearbox.
#pragma once
#include <algorithm>
#include <cmath>
#include <robot.h>

class Pedals {
  public:
    // What the car file says of a car, which TORCS does not change afterwards.
    explicit Pedals(tCarElt *car) : car_(car) {
        void *file = car->_carHandle;
        mass_ = GfParmGetNum(file, "Car", "mass", nullptr, 1000.0f) +
                GfParmGetNum(file, "Car", "initial fuel", nullptr, 0.0f) * 0.75;  // kg a litre
        wheel_radius_ = car->_wheelRadius(REAR_RGT);
        const double inertia = GfParmGetNum(file, "Rear Right Wheel", "inertia", nullptr, 1.5f);
        wheels_mass_ = 4.0 * inertia / (wheel_radius_ * wheel_radius_);
        const double area = GfParmGetNum(file, "Aerodynamics", "front area", nullptr, 2.0f);
        drag_ = 0.645 * area * GfParmGetNum(file, "Aerodynamics", "Cx", nullptr, 0.4f);  // half the density of air
        tickover_ = GfParmGetNum(file, "Engine", "tickover", nullptr, 100.0f);
        reset();
    }

    // Forgets what was, the last readings of the instruments too.
    void reset() {
        correction_ = 0.0;
        car_->_enginerpm = tickover_;
        car_->_gear = 0;
    }

    double mass() const { return mass_; }

    // At rest, wheels have to be spun up by the road; this is how much faster the car must be thrown onto it.
    double spin_up() const { return 1.0 + wheels_mass_ / mass_; }

    // How long it takes until the car, put on the road, pulls (s): about twice what its file says.
    double start_time() const { return 2.0 * GfParmGetNum(car_->_carHandle, "Gearbox", "shift time", nullptr, 0.2f); }

    // Rolls while the gear is put in, which takes TORCS its time; the engine is brought to the revolutions of that gear.
    void roll() {
        const int gear = suitable_gear();
        car_->_accelCmd = std::clamp(0.01 * (revolutions(gear) - car_->_enginerpm), 0.0, 1.0);
        car_->_brakeCmd = 0.0f;
        car_->_clutchCmd = 0.0f;
        car_->_gearCmd = gear;
    }

    // Holds a speed (m/s): the force it takes by Newton's law, corrected by the integral of the error over `dt` (s).
    void hold(double target, double dt) {
        const double error = target - car_->_speed_x;
        const double weight = mass_ * 9.81;
        double force = std::clamp(3.0 * error, -6.0, 4.0) * (mass_ + wheels_mass_);
        force += drag_ * car_->_speed_x * std::fabs(car_->_speed_x) + 0.02 * weight + correction_;
        shift();
        const double ratio = std::max(1.0f, car_->_gearRatio[car_->_gear + car_->_gearOffset]);
        const double strongest = car_->priv.engineMaxTq * ratio / wheel_radius_;
        const double throttle = force / strongest + idling(), brake = (-force - 0.05 * weight) / (1.5 * weight);
        car_->_accelCmd = std::clamp(throttle, 0.0, 1.0);
        car_->_brakeCmd = std::clamp(brake, 0.0, 1.0);
        if (throttle < 1.0 && brake < 1.0 && std::fabs(error) < 2.0)  // else the integral would wind up
            correction_ = std::clamp(correction_ + 2.0 * error * mass_ * dt, -0.6 * weight, 0.6 * weight);
    }

    // What the agent does with one number in [-1, 1]: throttle above 0, brake below.
    void press(double pedal) {
        shift();
        car_->_accelCmd = std::clamp(pedal, 0.0, 1.0);
        car_->_brakeCmd = std::clamp(-pedal, 0.0, 1.0);
    }

  private:
    // Up near the limit of the engine, down where the lower gear would leave room: far apart, so that none is hunted.
    void shift() {
        int gear = std::max(1, car_->_gear);
        if (gear < highest() && revolutions(gear) > 0.85 * car_->_enginerpmRedLine) ++gear;
        else if (gear > 1 && revolutions(gear - 1) < 0.6 * car_->_enginerpmRedLine) --gear;
        car_->_clutchCmd = 0.0f;
        car_->_gearCmd = gear;
    }

    // The throttle that makes up for the engine's own friction, which grows with its revolutions.
    double idling() const {
        return std::max(0.0, 0.28 * (car_->_enginerpm - tickover_) / car_->_enginerpmRedLine);
    }

    // Of the engine (rad/s), if a gear is engaged and no wheel slips.
    double revolutions(int gear) const {
        return std::max(0.0f, car_->_speed_x) / wheel_radius_ * car_->_gearRatio[gear + car_->_gearOffset];
    }

    // Gears are counted with neutral, and with reverse where there is one.
    int highest() const { return car_->_gearNb - 1 - car_->_gearOffset; }

    int suitable_gear() const {
        int gear = 1;
        while (gear < highest() && revolutions(gear) > 0.7 * car_->_enginerpmRedLine) ++gear;
        return gear;
    }

    tCarElt *car_;
    double mass_, wheel_radius_, wheels_mass_, drag_, tickover_, correction_;
};
