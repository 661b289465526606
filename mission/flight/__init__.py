"""Flights: plans as missions, the vehicles that fly them, recorded tracks, other programs' logs.

What is where, in the order in which a flight goes through it:

- `missions`, what is to be flown:
  - `round_mission`: a round's plan as stops, and those as mission items. `FlightPlan`, `Demand`
  - `plan_file`: `.plan` and waypoint files, read and written. `PlanFile`
  - `qgroundcontrol`: what a `.plan` may hold, scans and landing patterns included
  - `plan_check`: what of a plan file is refused, and how long it takes. `CheckedPath`
  - `mission_path`: where items lead, with jumps, circles and returns. `MissionPath`
  - `geofence`: an airspace as fence items, and fence items as zones
- `flyers`, who flies it:
  - `base`: what each way to fly has. `Flyer` takes the orders; `Backend` checks, and makes it;
    links to ground stations beside the one that flies
  - `choice`: which backend a configuration asks for
  - `built_in`, `firmware`, `external`, `unflown`: one backend and its flyer each
- `pilot`, how a vehicle is flown by MAVLink alone (MAVSDK):
  - `connection`: from a URL to a vehicle that can be flown
  - `pilot`: orders, each awaited. `Pilot`
  - `watch`: what telemetry said last. `Watch`, `Readiness`
  - `feed`: telemetry as samples and events for the log; `control_rows`: of its control
  - `parameters`: read, set for a flight, and what they allow
  - `dialects`: how PX4 and ArduPilot differ
  - `mavsdk_calls`: what MAVSDK's plugins lack
- `track`: what was flown. `FlownTrack`, `TrackPoint`, and when stops were passed
- `serve`: vehicles that stand alone (`aerofed sitl`, `aerofed world`, `aerofed.vehicle`)
- `logs`: PX4's, ArduPilot's and ground stations' logs as flights, and ours as ULog
"""
