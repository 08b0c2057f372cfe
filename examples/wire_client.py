"""A client in 33 lines that needs only `eclipse-zenoh` and `msgpack`, not this package.

The service needs a port: hsslam-serve --zenoh-port 7447.

python examples/wire_client.py [tcp/127.0.0.1:7447 [robot [poses]]]
"""

import json
import sys
import time

import msgpack
import zenoh

given = sys.argv[1:]
endpoint, robot, count = *given[:3], *("tcp/127.0.0.1:7447", "robot", "100")[len(given) :]
if len(given) > 3 or not count.isdecimal():
    sys.exit(f"{' '.join(given)}: expected ENDPOINT ROBOT POSES, as tcp/127.0.0.1:7447 robot 100")
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("scouting/multicast/enabled", "false")
try:
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    session = zenoh.open(config)
except zenoh.ZError:
    sys.exit(f"{endpoint}: no service: expected hsslam-serve --zenoh-port 7447")
with session:
    poses = session.declare_subscriber(f"hsslam/{robot}/out/pose", zenoh.handlers.RingChannel(16))
    ask = zenoh.Encoding("application/msgpack;hsslam.Ask.v1")
    replies = session.get(f"hsslam/{robot}/rpc/status", payload=msgpack.packb({}), encoding=ask)
    reply = next(iter(replies), None) or sys.exit(f"no run of robot {robot!r} at {endpoint}")
    answer = reply.ok or sys.exit("refused, or no answer in time")
    status = msgpack.unpackb(answer.payload.to_bytes())
    print("status:", status["state"], "keyframes:", status["keyframes"])
    for _ in range(int(count)):
        give_up_s = time.monotonic() + 10
        while (sample := poses.try_recv()) is None:
            if time.monotonic() > give_up_s:
                sys.exit("no pose for 10 s: the run has ended, or its camera sends nothing")
            time.sleep(0.01)
        pose = msgpack.unpackb(sample.payload.to_bytes())
        print(pose["index"], pose["status"], *(f"{metres:.3f}" for metres in pose["t"]), flush=True)
