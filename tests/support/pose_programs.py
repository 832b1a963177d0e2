"""Pose files as programs write them: name, text, convention that is stated, and how it ends."""
# ruff: noqa: E501

import json

import numpy as np
from scipy.spatial.transform import Rotation as R

from markergen.read.poses import poses_from

POSES = {}
TRUTH = poses_from("cone:distance=0.6..1.2m,tilt=0..45,count=6")
ROT, T = TRUTH.rotation, TRUTH.translation
n = len(T)
C, CR = -np.einsum("pji,pj->pi", ROT, T), np.swapaxes(ROT, 1, 2)
q, qm = R.from_matrix(CR).as_quat(), R.from_matrix(ROT).as_quat()
FLIP = np.diag([1.0, -1, -1])


def w(quaternions):
    return np.roll(quaternions, 1, axis=1)


def add(name, text, convention=None, ends="read"):
    POSES[name] = (text, convention or {}, ends)


def row(*parts, sep=" "):
    return sep.join(repr(float(x)) for x in np.concatenate([np.ravel(part) for part in parts]))


ts = 1403636579.76 + np.arange(n) * 0.05
tum = "\n".join(row([ts[i]], C[i], q[i]) for i in range(n)) + "\n"
add("tum bare", tum)
add("tum header", "# timestamp tx ty tz qx qy qz qw\n" + tum)
add("tum commas", "\n".join(row([ts[i]], C[i], q[i], sep=",") for i in range(n)) + "\n")
add("orbslam euroc ns", "\n".join(row([ts[i] * 1e9], C[i], q[i]) for i in range(n)) + "\n")
eh = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1],b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]\n"
eu = eh + "\n".join(row([ts[i] * 1e9], C[i], w(q)[i], np.zeros(9), sep=",") for i in range(n)) + "\n"
add("euroc", eu, ends="asked")
add("euroc camera", eu, {"frame": "camera-in-marker"})
vh = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n"
add(
    "tumvi mocap",
    vh + "\n".join(row([ts[i] * 1e9], C[i], w(q)[i], sep=",") for i in range(n)) + "\n",
    {"frame": "camera-in-marker"},
)
M34 = np.concatenate([CR, C[:, :, None]], axis=2)
M44 = np.concatenate([M34, np.tile([[[0, 0, 0, 1.0]]], (n, 1, 1))], axis=1)
add("kitti", "\n".join(row(M34[i]) for i in range(n)) + "\n")
add("kitti e", "\n".join(" ".join(f"{x:.12e}" for x in M34[i].ravel()) for i in range(n)) + "\n")
add("replica traj 16", "\n".join(" ".join(f"{x:.18e}" for x in M44[i].ravel()) for i in range(n)) + "\n")
add("4x4 block one", "\n".join(row(r) for r in M44[0]) + "\n", ends="read1")
add("4x4 blocks blank", "\n\n".join("\n".join(row(r) for r in M44[i]) for i in range(n)) + "\n")
add("open3d log", "\n".join(f"{i} {i} {i + 1}\n" + "\n".join(row(r) for r in M44[i]) for i in range(n)) + "\n")
rh = "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.position.x,field.pose.position.y,field.pose.position.z,field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w\n"
rb = (
    rh
    + "\n".join(f"{int(ts[i] * 1e9)},{i},{int(ts[i] * 1e9)},world," + row(C[i], q[i], sep=",") for i in range(n))
    + "\n"
)
add("rosbag csv", rb, ends="asked")
add("rosbag csv camera", rb, {"frame": "camera-in-marker"})
oh = (
    "%time,field.header.seq,field.header.frame_id,field.child_frame_id,field.pose.pose.position.x,field.pose.pose.position.y,field.pose.pose.position.z,field.pose.pose.orientation.x,field.pose.pose.orientation.y,field.pose.pose.orientation.z,field.pose.pose.orientation.w,"
    + ",".join(f"field.pose.covariance{i}" for i in range(36))
    + ",field.twist.twist.linear.x,field.twist.twist.linear.y,field.twist.twist.linear.z,field.twist.twist.angular.x,field.twist.twist.angular.y,field.twist.twist.angular.z\n"
)
add(
    "rosbag odometry",
    oh
    + "\n".join(f"{int(ts[i] * 1e9)},{i},odom,base_link," + row(C[i], q[i], np.zeros(42), sep=",") for i in range(n))
    + "\n",
    {"frame": "camera-in-marker"},
)
ph = "__time,/pose/header/stamp,/pose/pose/position/x,/pose/pose/position/y,/pose/pose/position/z,/pose/pose/orientation/x,/pose/pose/orientation/y,/pose/pose/orientation/z,/pose/pose/orientation/w\n"
add(
    "plotjuggler",
    ph + "\n".join(row([ts[i], ts[i]], C[i], q[i], sep=",") for i in range(n)) + "\n",
    {"frame": "camera-in-marker"},
)
gl = CR @ FLIP
G44 = np.concatenate([np.concatenate([gl, C[:, :, None]], axis=2), np.tile([[[0, 0, 0, 1.0]]], (n, 1, 1))], axis=1)
add(
    "nerf",
    json.dumps(
        {
            "camera_angle_x": 0.7,
            "frames": [
                {"file_path": f"{i}.png", "rotation": 0.01, "transform_matrix": G44[i].tolist()} for i in range(n)
            ],
        }
    ),
)
add(
    "nerfstudio",
    json.dumps(
        {
            "w": 1280,
            "h": 720,
            "fl_x": 900.0,
            "fl_y": 900.0,
            "cx": 640,
            "cy": 360,
            "camera_model": "OPENCV",
            "applied_transform": [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]],
            "ply_file_path": "a",
            "frames": [
                {"file_path": f"{i}.png", "colmap_im_id": i, "transform_matrix": G44[i].tolist()} for i in range(n)
            ],
        }
    ),
    ends="warned",
)
ch = "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n# Number of images: 6, mean observations per image: 2\n"
add("colmap", ch + "".join(f"{i + 1} {row(w(qm)[i], T[i])} 1 im {i}.png\n1.5 2.5 -1 3.5 4.5 7\n" for i in range(n)))
kh = "# kapture format: 1.1\n# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz\n"
add(
    "kapture",
    kh + "".join(f"{i}, cam0, {', '.join(map(repr, [*w(qm)[i].tolist(), *T[i].tolist()]))}\n" for i in range(n)),
)
add(
    "bop scene_gt",
    json.dumps(
        {
            str(i): [{"cam_R_m2c": ROT[i].ravel().tolist(), "cam_t_m2c": (T[i] * 1000).tolist(), "obj_id": 1}]
            for i in range(n)
        }
    ),
)
rv = R.from_matrix(ROT).as_rotvec()
add(
    "rvec csv",
    "frame,rvec_x,rvec_y,rvec_z,tvec_x,tvec_y,tvec_z\n"
    + "\n".join(f"{i}," + row(rv[i], T[i], sep=",") for i in range(n))
    + "\n",
)
add("rvec json", json.dumps([{"rvec": rv[i].tolist(), "tvec": T[i].tolist()} for i in range(n)]))
add(
    "rvecs tvecs",
    json.dumps({"rvecs": [[[x] for x in rv[i]] for i in range(n)], "tvecs": [[[x] for x in T[i]] for i in range(n)]}),
)
add("own csv", "tx,ty,tz,qx,qy,qz,qw\n" + "\n".join(row(T[i], qm[i], sep=",") for i in range(n)) + "\n")
add(
    "own csv mm",
    "tx_mm,ty_mm,tz_mm,qx,qy,qz,qw\n" + "\n".join(row(T[i] * 1e3, qm[i], sep=",") for i in range(n)) + "\n",
)
add(
    "position orientation lists",
    json.dumps([{"position": C[i].tolist(), "orientation": q[i].tolist()} for i in range(n)]),
    ends="refused",
)
add(
    "nested dict",
    json.dumps(
        [
            {
                "translation": dict(zip("xyz", T[i].tolist(), strict=False)),
                "rotation": dict(zip("xyzw", qm[i].tolist(), strict=False)),
            }
            for i in range(n)
        ]
    ),
)
add("matrices json", json.dumps([M44[i].tolist() for i in range(n)]), ends="asked")
add(
    "ros yaml",
    "".join(
        f"header:\n  stamp:\n    sec: {i}\n    nanosec: 5\n  frame_id: camera\npose:\n  position:\n    x: {T[i][0]}\n    y: {T[i][1]}\n    z: {T[i][2]}\n  orientation:\n    x: {qm[i][0]}\n    y: {qm[i][1]}\n    z: {qm[i][2]}\n    w: {qm[i][3]}\n---\n"
        for i in range(n)
    ),
    ends="refused",
)
add(
    "g2o",
    "".join(f"VERTEX_SE3:QUAT {i} {row(C[i], q[i])}\n" for i in range(n))
    + "EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n",
    ends="refused",
)
add(
    "openvins jpl",
    "# timestamp(s) q_GtoI(JPL) p_IinG\n" + "\n".join(row([ts[i]], q[i], C[i]) for i in range(n)) + "\n",
    ends="refused",
)
add(
    "openvins ok",
    "# timestamp(s) tx ty tz qx qy qz qw Pr11 Pr12 Pr13 Pr22 Pr23 Pr33 Pt11 Pt12 Pt13 Pt22 Pt23 Pt33\n"
    + "\n".join(row([ts[i]], C[i], q[i], np.ones(12)) for i in range(n))
    + "\n",
    ends="warned",
)
add(
    "motive",
    "Format Version,1.23,Take Name,a,Capture Frame Rate,120\n\n,,RigidBody,RigidBody\n,,body,body\n,,Rotation,Position\nFrame,Time,X,Y,Z,W,X,Y,Z\n0,0.0,0,0,0,1,0,0,1\n",
    ends="refused",
)
add("qualisys 6d", "NO_OF_FRAMES\t6\nNO_OF_CAMERAS\t8\nNO_OF_BODIES\t1\nFREQUENCY\t100\n", ends="refused")
add(
    "opensfm reconstruction",
    json.dumps([{"cameras": {}, "shots": {"a.jpg": {"rotation": [0, 0, 0], "translation": [0, 0, 1]}}}]),
    ends="refused",
)
add("euler csv", "x,y,z,roll,pitch,yaw\n0,0,1,180,0,0\n", ends="refused")
add("reality csv", "#name,x,y,alt,heading,pitch,roll\na.jpg,0,0,1,0,0,0\n", ends="refused")
add(
    "rpg header w first",
    "# timestamp tx ty tz qw qx qy qz\n" + "\n".join(row([ts[i]], C[i], w(q)[i]) for i in range(n)) + "\n",
)
add("comment wxyz", "# quaternion order: w x y z\n" + "\n".join(row([ts[i]], C[i], w(q)[i]) for i in range(n)) + "\n")
add(
    "tum mm header",
    "# timestamp tx[mm] ty[mm] tz[mm] qx qy qz qw\n"
    + "\n".join(row([ts[i]], C[i] * 1e3, q[i]) for i in range(n))
    + "\n",
)
add("tum mm bare", "\n".join(row([ts[i]], C[i] * 1e3, q[i]) for i in range(n)) + "\n", ends="doubt")
add("tum cm bare", "\n".join(row([ts[i]], C[i] * 1e2, q[i]) for i in range(n)) + "\n", ends="doubt")
add("tum wxyz bare", "\n".join(row([ts[i]], C[i], w(q)[i]) for i in range(n)) + "\n", ends="doubt")
add(
    "tum opengl bare",
    "\n".join(row([ts[i]], C[i], R.from_matrix(gl).as_quat()[i]) for i in range(n)) + "\n",
    ends="doubt",
)
add(
    "gaussian",
    json.dumps(
        [
            {
                "id": i,
                "img_name": f"{i}",
                "width": 1280,
                "height": 720,
                "position": C[i].tolist(),
                "rotation": CR[i].tolist(),
                "fy": 900.0,
                "fx": 900.0,
            }
            for i in range(n)
        ]
    ),
    ends="refused",
)
add(
    "semicolon de",
    "t;x;y;z;qx;qy;qz;qw\n"
    + "\n".join(";".join(f"{v:.9f}".replace(".", ",") for v in [i, *T[i], *qm[i]]) for i in range(n))
    + "\n",
    ends="refused",
)
add("pandas index", ",tx,ty,tz,qx,qy,qz,qw\n" + "\n".join(f"{i}," + row(T[i], qm[i], sep=",") for i in range(n)) + "\n")
add(
    "r11 csv",
    "tx,ty,tz,r11,r12,r13,r21,r22,r23,r31,r32,r33\n" + "\n".join(row(T[i], ROT[i], sep=",") for i in range(n)) + "\n",
)
add(
    "position_x csv",
    "position_x,position_y,position_z,orientation_x,orientation_y,orientation_z,orientation_w\n"
    + "\n".join(row(T[i], qm[i], sep=",") for i in range(n))
    + "\n",
    ends="asked",
)
add("percent comments", "% by hand\n% timestamp tx ty tz qx qy qz qw\n" + tum)
add(
    "slashes w first",
    "// timestamp tx ty tz qw qx qy qz\n" + "".join(row([ts[i]], C[i], w(q)[i]) + "\n" for i in range(n)),
)
add("a name before the columns", "# T_WC: timestamp tx ty tz qx qy qz qw\n" + tum)
add("real part first", "# real part first\n" + "".join(row([ts[i]], C[i], w(q)[i]) + "\n" for i in range(n)))
listed = [{"position": C[i].tolist(), "quaternion_wxyz": w(q)[i].tolist()} for i in range(n)]
add("order in a key", json.dumps(listed), {"frame": "camera-in-marker"})
add(
    "matrices under w2c",
    json.dumps([{"w2c": np.vstack([np.c_[ROT[i], T[i]], [0, 0, 0, 1]]).tolist()} for i in range(n)]),
)
add("matrices of poses", json.dumps([{"pose": M44[i].tolist()} for i in range(n)]), ends="asked")
add("matrices of cameras", json.dumps([{"pose": M44[i].tolist()} for i in range(n)]), {"frame": "camera-in-marker"})
add(
    "nerf by opencv",
    json.dumps({"camera_convention": "opencv", "frames": [{"transform_matrix": m.tolist()} for m in M44]}),
    ends="asked",
)
