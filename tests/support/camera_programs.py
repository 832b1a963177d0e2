"""Camera files as programs write them: name, text, lens with its coefficients (or that it is refused), end of the path.

All have fx 700.25, fy 701.5, cx 642.125, cy 355.75 in images of 1280 x 720 px.
"""
# ruff: noqa: E501

import json

LENS, EYE = (0.1, -0.02, 0.001, -0.002, 0.003, 0.02, -0.01, 0.004), (-0.01, 0.003, -0.001, 0.0002)
NUMBERS = {"fx": 700.25, "fy": 701.5, "cx": 642.125, "cy": 355.75}
MATRIX = [[700.25, 0, 642.125], [0, 701.5, 355.75], [0, 0, 1]]
R9, C9 = [v for row in MATRIX for v in row], [MATRIX[j][i] for i in range(3) for j in range(3)]
R4, R5, RAT = ("radtan", LENS[:4]), ("radtan", LENS[:5]), ("rational", LENS)
EQ, FLAT, REFUSED = ("equidistant", EYE), ("none", ()), "refused"
S = "#1280x720"
CAMERAS = {}


def add(name, text, lens, suffix=""):
    CAMERAS[name] = (text, lens, suffix)


def ocv(name, rows, cols, values):
    data = ", ".join(map(str, values))
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]\n"


def svo(kind, terms):
    return (
        "label: Eurocams\nid: 412eab\ncameras:\n- camera:\n    label: cam0\n    id: 548125\n    image_height: 720\n"
        "    image_width: 1280\n    type: pinhole\n    intrinsics:\n      cols: 1\n      rows: 4\n"
        f"      data: [700.25, 701.5, 642.125, 355.75]\n    distortion:\n      type: {kind}\n      parameters:\n"
        f"        cols: 1\n        rows: 4\n        data: {list(terms)}\n  T_B_C:\n    cols: 1\n    rows: 1\n    data: [1]\n"
    )


add(
    "opencv sample",
    '%YAML:1.0\n---\ncalibration_time: "Thu 26 Nov 2026"\nnframes: 12\nimage_width: 1280\nimage_height: 720\nboard_width: 9\nboard_height: 6\nsquare_size: 2.5e-02\n# flags: \nflags: 0\n'
    + ocv("camera_matrix", 3, 3, R9)
    + ocv("distortion_coefficients", 5, 1, LENS[:5])
    + "avg_reprojection_error: 0.21\n"
    + ocv("per_view_reprojection_errors", 2, 1, [0.2, 0.3])
    + "# a set of 6-tuples (rotation vector + translation vector) for each view\n"
    + ocv("extrinsic_parameters", 1, 6, [0, 0, 0, 0, 0, 1])
    + ocv("image_points", 1, 2, [1, 2]),
    R5,
)
add(
    "opencv tutorial xml",
    '<?xml version="1.0"?>\n<opencv_storage>\n<calibration_time>"Thu"</calibration_time>\n<nr_of_frames>25</nr_of_frames>\n<image_width>1280</image_width>\n<image_height>720</image_height>\n<board_width>9</board_width>\n<square_size>50.</square_size>\n<fix_aspect_ratio>1.</fix_aspect_ratio>\n<!-- flags:  +fix_aspectRatio +fix_principal_point +zero_tangent_dist +fix_k4 +fix_k5 -->\n<flags>6158</flags>\n<fisheye_model>0</fisheye_model>\n<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>'
    + " ".join(map(str, R9))
    + '</data></camera_matrix>\n<distortion_coefficients type_id="opencv-matrix"><rows>5</rows><cols>1</cols><dt>d</dt><data>'
    + " ".join(map(str, LENS[:5]))
    + "</data></distortion_coefficients>\n<avg_reprojection_error>2.1e-01</avg_reprojection_error>\n</opencv_storage>\n",
    R5,
)
add(
    "opencv tutorial fisheye",
    CAMERAS["opencv tutorial xml"][0]
    .replace("<fisheye_model>0", "<fisheye_model>1")
    .replace(" +fix_aspectRatio", "")
    .replace("<rows>5", "<rows>4")
    .replace(" ".join(map(str, LENS[:5])), " ".join(map(str, EYE))),
    EQ,
)
add(
    "metashape opencv",
    CAMERAS["opencv tutorial xml"][0]
    .replace("image_width", "image_Width")
    .replace("image_height", "image_Height")
    .replace("camera_matrix", "Camera_Matrix")
    .replace("distortion_coefficients", "Distortion_Coefficients")
    .replace("fisheye_model", "junkless"),
    R5,
)
add("course yaml", json.dumps({"camera_matrix": MATRIX, "dist_coeff": [list(LENS[:5])]}), R5, S)
add("course K D", f"K: {MATRIX}\nD: {list(LENS[:5])}\n", R5, S)
add("K.txt", "\n".join(" ".join(map(str, r)) for r in MATRIX) + "\n", FLAT, S)
add("K.csv", "\n".join(",".join(f"{v:.18e}" for v in r) for r in MATRIX) + "\n", FLAT, S)
add(
    "scannet 4x4",
    "\n".join(" ".join(map(str, r)) for r in [[*MATRIX[0], 0], [*MATRIX[1], 0], [0, 0, 1, 0], [0, 0, 0, 1]]) + "\n",
    FLAT,
    S,
)
add(
    "ros ost.txt",
    "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n1280\n\nheight\n720\n\n[narrow_stereo]\n\ncamera matrix\n"
    + "\n".join(" ".join(map(str, r)) for r in MATRIX)
    + "\n\ndistortion\n"
    + " ".join(map(str, LENS[:5]))
    + "\n\nrectification\n1 0 0\n0 1 0\n0 0 1\n\nprojection\n690 0 640 0\n0 690 355 0\n0 0 1 0\n",
    R5,
)
add(
    "ros echo",
    'header: \n  seq: 12\n  stamp: \n    secs: 1\n    nsecs: 2\n  frame_id: "cam"\nheight: 720\nwidth: 1280\ndistortion_model: "plumb_bob"\nD: '
    + str(list(LENS[:5]))
    + "\nK: "
    + str(R9)
    + "\nR: [1,0,0,0,1,0,0,0,1]\nP: [690,0,640,0,0,690,355,0,0,0,1,0]\nbinning_x: 0\nbinning_y: 0\nroi: \n  x_offset: 0\n  y_offset: 0\n  height: 0\n  width: 0\n  do_rectify: False\n---\n",
    R5,
)
add(
    "ros2 echo",
    "header:\n  stamp:\n    sec: 1\n    nanosec: 2\n  frame_id: cam\nheight: 720\nwidth: 1280\ndistortion_model: equidistant\nd:\n"
    + "".join(f"- {v}\n" for v in EYE)
    + "k:\n"
    + "".join(f"- {v}\n" for v in R9)
    + "r:\n- 1.0\n- 0.0\n- 0.0\n- 0.0\n- 1.0\n- 0.0\n- 0.0\n- 0.0\n- 1.0\np:\n"
    + "".join(f"- {v}\n" for v in [690, 0, 640, 0, 0, 690, 355, 0, 0, 0, 1, 0])
    + "binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 0\n  y_offset: 0\n  height: 0\n  width: 0\n  do_rectify: false\n---\n",
    EQ,
)
add(
    "rtabmap",
    "%YAML:1.0\n---\ncamera_name: cam\nimage_width: 1280\nimage_height: 720\n"
    + ocv("camera_matrix", 3, 3, R9)
    + ocv("distortion_coefficients", 1, 5, LENS[:5])
    + "distortion_model: plumb_bob\n"
    + ocv("rectification_matrix", 3, 3, [1, 0, 0, 0, 1, 0, 0, 0, 1])
    + ocv("projection_matrix", 3, 4, [690, 0, 640, 0, 0, 690, 355, 0, 0, 0, 1, 0])
    + ocv("local_transform", 3, 4, [0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 0]),
    R5,
)
vins = '%YAML:1.0\n\n#common parameters\nimu_topic: "/imu0"\nimage_topic: "/cam0/image_raw"\noutput_path: "/home/x/"\n\nmodel_type: PINHOLE\ncamera_name: camera\nimage_width: 1280\nimage_height: 720\ndistortion_parameters:\n   k1: 0.1\n   k2: -0.02\n   p1: 0.001\n   p2: -0.002\nprojection_parameters:\n   fx: 700.25\n   fy: 701.5\n   cx: 642.125\n   cy: 355.75\n\nestimate_extrinsic: 0\nextrinsicRotation: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [0,-1,0,1,0,0,0,0,1]\nmax_cnt: 150\nmin_dist: 30\nfreq: 10\nF_threshold: 1.0\nshow_track: 1\nequalize: 1\nfisheye: 0\nmax_solver_time: 0.04\nacc_n: 0.08\ng_norm: 9.81007\nloop_closure: 1\ntd: 0.0\nrolling_shutter: 0\n'
add("vins-mono", vins, R4)
add(
    "openvins",
    "%YAML:1.0\n\ncam0:\n  T_imu_cam: #rotation from camera to IMU R_CtoI\n    - [0.01, -0.99, 0.004, -0.02]\n    - [0.9, 0.01, 0.02, -0.06]\n    - [-0.02, 0.003, 0.99, 0.009]\n    - [0.0, 0.0, 0.0, 1.0]\n  cam_overlaps: [1]\n  camera_model: pinhole\n  distortion_coeffs: [0.1,-0.02,0.001,-0.002]\n  distortion_model: radtan\n  intrinsics: [700.25,701.5,642.125,355.75] #fu, fv, cu, cv\n  resolution: [1280, 720]\n  rostopic: /cam0/image_raw\n",
    R4,
)
okvis = "%YAML:1.0\ncameras:\n     - {T_SC:\n        [ 0.01, -0.99, 0.004, -0.02,\n          0.9, 0.01, 0.02, -0.06,\n         -0.02, 0.003, 0.99, 0.009,\n          0.0, 0.0, 0.0, 1.0],\n        image_dimension: [1280, 720],\n        distortion_coefficients: [0.1,-0.02,0.001,-0.002],\n        distortion_type: radialtangential,\n        focal_length: [700.25, 701.5],\n        principal_point: [642.125, 355.75]}\n"
add(
    "okvis",
    okvis
    + "camera_params:\n    camera_rate: 20\n    sigma_absolute_translation: 0.0\n    timestamp_tolerance: 0.005\nimu_params:\n    a_max: 176.0\n",
    R4,
)
euroc = "# General sensor definitions.\nsensor_type: camera\ncomment: VI-Sensor cam0 (MT9M034)\n\n# Sensor extrinsics wrt. the body-frame.\nT_BS:\n  cols: 4\n  rows: 4\n  data: [0.01, -0.99, 0.004, -0.02, 0.9, 0.01, 0.02, -0.06, -0.02, 0.003, 0.99, 0.009, 0.0, 0.0, 0.0, 1.0]\n\n# Camera specific definitions.\nrate_hz: 20\nresolution: [1280, 720]\ncamera_model: pinhole\nintrinsics: [700.25, 701.5, 642.125, 355.75] #fu, fv, cu, cv\ndistortion_model: radial-tangential\ndistortion_coefficients: [0.1,-0.02,0.001,-0.002]\n"
add("euroc sensor.yaml", euroc, R4)
add(
    "kimera",
    "%YAML:1.0\n# General sensor definitions.\ncamera_id: left_cam\n\n"
    + euroc.split("comment:")[1].split("\n", 1)[1].replace("cols: 4\n  rows: 4\n", "cols: 4\n  rows: 4\n"),
    R4,
)
add("svo", svo("radial-tangential", LENS[:4]), R4)
add("maplab equidistant", svo("equidistant", EYE), EQ)
add("dso", "Pinhole 700.25 701.5 642.125 355.75 0\n1280 720\ncrop\n640 480\n", FLAT)
add("dso radtan", "RadTan 700.25 701.5 642.125 355.75 0.1 -0.02 0.001 -0.002\n1280 720\ncrop\n640 480\n", R4)
add("dso equi", "EquiDistant 700.25 701.5 642.125 355.75 -0.01 0.003 -0.001 0.0002\n1280 720\nfull\n640 480\n", EQ)
osfm = {
    "projection_type": "brown",
    "width": 1280,
    "height": 720,
    "focal_x": 700.25 / 1280,
    "focal_y": 701.5 / 1280,
    "c_x": (642.125 - 639.5) / 1280,
    "c_y": (355.75 - 359.5) / 1280,
    "k1": 0.1,
    "k2": -0.02,
    "p1": 0.001,
    "p2": -0.002,
    "k3": 0.003,
}
add("opensfm brown", json.dumps({"v2 unknown unknown 1280 720 brown 0.85": osfm}), R5)
add(
    "opensfm fisheye_opencv",
    json.dumps(
        {
            "v2 x": {
                **{k: v for k, v in osfm.items() if k[0] not in "kp" or k == "projection_type"},
                "projection_type": "fisheye_opencv",
                "k1": EYE[0],
                "k2": EYE[1],
                "k3": EYE[2],
                "k4": EYE[3],
            }
        }
    ),
    EQ,
)
add("open3d", json.dumps({"width": 1280, "height": 720, "intrinsic_matrix": C9}), FLAT)
add(
    "open3d parameters",
    json.dumps(
        {
            "class_name": "PinholeCameraParameters",
            "extrinsic": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1],
            "intrinsic": {"height": 720, "intrinsic_matrix": C9, "width": 1280},
            "version_major": 1,
            "version_minor": 0,
        }
    ),
    FLAT,
)
add("record3d", json.dumps({"w": 1280, "h": 720, "K": C9, "fps": 60, "poses": [[0, 0, 0, 1, 0, 0, 0]]}), FLAT)
add(
    "3d scanner app",
    json.dumps(
        {
            "frame_index": 0,
            "time": 1.0,
            "intrinsics": R9,
            "projectionMatrix": [0] * 16,
            "cameraPoseARFrame": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        }
    ),
    FLAT,
    S,
)
add(
    "polycam",
    json.dumps(
        {
            **NUMBERS,
            "width": 1280,
            "height": 720,
            "t_00": 1,
            "t_01": 0,
            "t_02": 0,
            "t_03": 0,
            "t_10": 0,
            "t_11": 1,
            "t_12": 0,
            "t_13": 0,
            "t_20": 0,
            "t_21": 0,
            "t_22": 1,
            "t_23": 0,
            "blur_score": 100.0,
            "timestamp": 123,
        }
    ),
    FLAT,
)
add("bop", json.dumps({**NUMBERS, "depth_scale": 0.1, "height": 720, "width": 1280}), FLAT)
add("replica", json.dumps({"camera": {"w": 1280, "h": 720, **NUMBERS, "scale": 6553.5}}), FLAT)
add(
    "cityscapes",
    json.dumps(
        {
            "extrinsic": {"baseline": 0.2, "pitch": 0.003, "roll": 0, "x": 1.7, "y": 0.1, "yaw": 0.01, "z": 1.2},
            "intrinsic": {"fx": 700.25, "fy": 701.5, "u0": 642.125, "v0": 355.75},
        }
    ),
    FLAT,
    S,
)
add(
    "multical",
    json.dumps(
        {
            "cameras": {
                "cam1": {"model": "standard", "image_size": [1280, 720], "K": MATRIX, "dist": [list(LENS[:5])]}
            },
            "camera_poses": {"cam1": {"R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "T": [0, 0, 0]}},
        }
    ),
    R5,
)
anip = '[cam_0]\nname = "A"\nsize = [ 1280, 720,]\nmatrix = [ [ 700.25, 0.0, 642.125,], [ 0.0, 701.5, 355.75,], [ 0.0, 0.0, 1.0,],]\ndistortions = [ 0.1, -0.02, 0.001, -0.002, 0.003,]\nrotation = [ 0.0, 0.0, 0.0,]\ntranslation = [ 0.0, 0.0, 0.0,]\n'
add(
    "anipose",
    anip
    + "\n"
    + anip.replace("cam_0", "cam_1").replace('"A"', '"B"').replace("700.25", "600.25")
    + "\n[metadata]\nadjusted = false\nerror = 0.4\n",
    R5,
    "#cam_0",
)
add("pose2sim", anip + "fisheye = false\n\n[metadata]\nadjusted = false\nerror = 0.0\n", R5)
add(
    "easymocap",
    '%YAML:1.0\n---\nnames:\n   - "1"\n   - "2"\n'
    + ocv("K_1", 3, 3, R9)
    + "H_1: 720\nW_1: 1280\n"
    + ocv("dist_1", 1, 5, LENS[:5])
    + ocv("K_2", 3, 3, [600, 0, 640, 0, 600, 360, 0, 0, 1])
    + ocv("dist_2", 1, 5, [0] * 5),
    R5,
    "#1",
)
add(
    "panoptic",
    json.dumps(
        {
            "calibDataSource": "x",
            "cameras": [
                {
                    "name": "00_00",
                    "type": "hd",
                    "resolution": [1280, 720],
                    "panel": 0,
                    "node": 0,
                    "K": MATRIX,
                    "distCoef": list(LENS[:5]),
                    "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
                    "t": [[0], [0], [0]],
                }
            ],
        }
    ),
    R5,
)
add(
    "stereo_calib",
    "%YAML:1.0\n---\n"
    + ocv("M1", 3, 3, R9)
    + ocv("D1", 1, 5, LENS[:5])
    + ocv("M2", 3, 3, [600, 0, 640, 0, 600, 360, 0, 0, 1])
    + ocv("D2", 1, 5, [0] * 5),
    R5,
    "#1" + S,
)
add(
    "stereo names",
    json.dumps(
        {
            "camera_matrix_left": MATRIX,
            "dist_coeffs_left": list(LENS[:5]),
            "camera_matrix_right": MATRIX,
            "dist_coeffs_right": [0] * 5,
            "image_size": [1280, 720],
            "R": [],
            "T": [],
        }
    ),
    R5,
    "#left",
)
add(
    "kinect2_bridge",
    "%YAML:1.0\n"
    + ocv("cameraMatrix", 3, 3, R9)
    + ocv("distortionCoefficients", 1, 5, LENS[:5])
    + ocv("rotation", 3, 3, [1, 0, 0, 0, 1, 0, 0, 0, 1])
    + ocv("projection", 4, 4, [0] * 16),
    R5,
    S,
)
add(
    "calibdb",
    json.dumps(
        {
            "camera": "cam",
            "platform": "x",
            "image_size": [1280, 720],
            "camera_matrix": NUMBERS,
            "distortion_coefficients": {"k1": 0.1, "k2": -0.02, "p1": 0.001, "p2": -0.002, "k3": 0.003},
            "distortion_model": "rectilinear",
            "avg_reprojection_error": 0.3,
        }
    ),
    R5,
)
add(
    "calibdb img_size",
    json.dumps(
        {
            "camera": "cam",
            "platform": "x",
            "img_size": [1280, 720],
            "camera_matrix": {**NUMBERS},
            "distortion_coefficients": [0.1, -0.02, 0.001, -0.002, 0.003],
            "distortion_model": "rectilinear",
            "avg_reprojection_error": 0.3,
            "keyframes": [[0, 0]],
            "calibration_time": "x",
        }
    ),
    R5,
)
add(
    "wpical",
    json.dumps(
        {
            "camera_matrix": R9,
            "distortion_coefficients": list(LENS),
            "avg_reprojection_error": 0.3,
            "num_images": 20,
            "image_width": 1280,
            "image_height": 720,
        }
    ),
    RAT,
)
add(
    "gyroflow",
    json.dumps(
        {
            "name": "GoPro",
            "note": "",
            "calibrated_by": "x",
            "camera_brand": "GoPro",
            "camera_model": "HERO6 Black",
            "lens_model": "Wide",
            "calib_dimension": {"w": 1280, "h": 720},
            "orig_dimension": {"w": 1280, "h": 720},
            "output_dimension": {"w": 1280, "h": 720},
            "frame_readout_time": None,
            "fps": 59.94,
            "official": False,
            "asymmetrical": False,
            "fisheye_params": {"RMS_error": 1.3, "camera_matrix": MATRIX, "distortion_coeffs": list(EYE)},
            "distortion_model": "opencv_fisheye",
            "calibrator_version": "1.0",
        }
    ),
    EQ,
)
add(
    "kitti raw",
    "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.950000e-02\nS_00: 1.280000e+03 7.200000e+02\nK_00: "
    + " ".join(f"{v:.6e}" for v in R9)
    + "\nD_00: "
    + " ".join(f"{v:.6e}" for v in LENS[:5])
    + "\nR_00: 1 0 0 0 1 0 0 0 1\nT_00: 0 0 0\nS_rect_00: 1.242000e+03 3.750000e+02\nP_rect_00: 7.2e+02 0 6.0e+02 0 0 7.2e+02 1.7e+02 0 0 0 1 0\nS_01: 1.280000e+03 7.200000e+02\nK_01: 600 0 640 0 600 360 0 0 1\nD_01: 0 0 0 0 0\n",
    R5,
    "#00",
)
add(
    "voxl MATRIX D",
    "%YAML:1.0\n---\n"
    + ocv("M", 3, 3, R9)
    + ocv("D", 4, 1, EYE)
    + 'reprojection_error: 0.2\nwidth: 1280\nheight: 720\ndistortion_model: fisheye\ncalibration_time: "2022"\n',
    EQ,
)
add(
    "openvslam flat",
    'Camera.name: "x"\nCamera.setup: "monocular"\nCamera.model: "perspective"\nCamera.fx: 700.25\nCamera.fy: 701.5\nCamera.cx: 642.125\nCamera.cy: 355.75\nCamera.k1: 0.1\nCamera.k2: -0.02\nCamera.p1: 0.001\nCamera.p2: -0.002\nCamera.k3: 0.003\nCamera.fps: 30.0\nCamera.cols: 1280\nCamera.rows: 720\nCamera.color_order: "RGB"\nFeature.max_num_keypoints: 1000\n',
    R5,
)
add(
    "orb no size",
    '%YAML:1.0\n\nCamera.type: "PinHole"\n'
    + "".join(f"Camera.{k}: {v}\n" for k, v in NUMBERS.items())
    + "Camera.k1: 0.1\nCamera.k2: -0.02\nCamera.p1: 0.001\nCamera.p2: -0.002\nCamera.fps: 30.0\nORBextractor.nFeatures: 1000\nViewer.PointSize:2\n".replace(
        "Viewer.PointSize:2\n", ""
    ),
    R4,
    S,
)
add(
    "zed conf",
    "[LEFT_CAM_HD]\nfx=700.25\nfy=701.5\ncx=642.125\ncy=355.75\nk1=0.1\nk2=-0.02\np1=0.001\np2=-0.002\nk3=0.003\n\n[RIGHT_CAM_HD]\nfx=600\nfy=600\ncx=640\ncy=360\nk1=0\nk2=0\np1=0\np2=0\nk3=0\n\n[STEREO]\nBaseline=119.9\nTY=0.1\n",
    R5,
    "#LEFT_CAM_HD" + S,
)
add(
    "matlab struct",
    json.dumps(
        {
            "RadialDistortion": [0.1, -0.02, 0.003],
            "TangentialDistortion": [0.001, -0.002],
            "ImageSize": [720, 1280],
            "WorldPoints": [],
            "WorldUnits": "mm",
            "EstimateSkew": False,
            "NumRadialDistortionCoefficients": 3,
            "EstimateTangentialDistortion": True,
            "RotationVectors": [],
            "TranslationVectors": [],
            "ReprojectionErrors": [],
            "Version": {},
            "K": [[700.25, 0, 643.125], [0, 701.5, 356.75], [0, 0, 1]],
        }
    ),
    R5,
)
add(
    "nerfstudio single frames",
    json.dumps(
        {
            "camera_model": "OPENCV",
            "frames": [
                {
                    "file_path": "a.png",
                    "fl_x": 700.25,
                    "fl_y": 701.5,
                    "cx": 642.625,
                    "cy": 356.25,
                    "w": 1280,
                    "h": 720,
                    "k1": 0.1,
                    "k2": -0.02,
                    "p1": 0.001,
                    "p2": -0.002,
                    "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]],
                }
            ]
            * 2,
        }
    ),
    R4,
)
add(
    "middlebury",
    "cam0=[700.25 0 642.125; 0 701.5 355.75; 0 0 1]\ncam1=[700.25 0 650; 0 701.5 355.75; 0 0 1]\ndoffs=131.111\nbaseline=193.001\nwidth=1280\nheight=720\nndisp=280\n",
    FLAT,
    "#0",
)
add(
    "realsense text",
    "[ 1280x720  p[642.125 355.75]  f[700.25 701.5]  Brown Conrady [0.1 -0.02 0.001 -0.002 0.003] ]\n",
    R5,
)
add(
    "azure kinect",
    json.dumps(
        {
            "CalibrationInformation": {
                "Cameras": [
                    {
                        "Intrinsics": {
                            "ModelParameterCount": 14,
                            "ModelParameters": [0.5] * 14,
                            "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
                        },
                        "Location": "CALIBRATION_CameraLocationD0",
                        "SensorWidth": 1024,
                        "SensorHeight": 1024,
                    }
                ]
            }
        }
    ),
    REFUSED,
)
add(
    "opensfm perspective",
    json.dumps(
        {
            "v2 x": {
                "projection_type": "perspective",
                "width": 1280,
                "height": 720,
                "focal": 700.0 / 1280,
                "k1": 0.1,
                "k2": -0.02,
            }
        }
    ),
    ("radtan", (0.1, -0.02, 0, 0)),
)
add("blenderproc", json.dumps({"cam_K": R9, "depth_scale": 1.0}), FLAT, S)
add(
    "bop scene",
    json.dumps({"0": {"cam_K": R9, "depth_scale": 0.1}, "1": {"cam_K": R9, "depth_scale": 0.1}}),
    FLAT,
    "#0" + S,
)
add(
    "ioopencv storage legacy",
    '<?xml version="1.0"?>\n<opencv_storage>\n<Intrinsics type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>f</dt><data>'
    + " ".join(map(str, R9))
    + "</data></Intrinsics>\n</opencv_storage>\n",
    REFUSED,
)
add(
    "metashape xml",
    '<?xml version="1.0" encoding="UTF-8"?>\n<calibration>\n  <projection>frame</projection>\n  <width>1280</width>\n  <height>720</height>\n  <f>700</f>\n  <cx>2.1</cx>\n  <cy>-3</cy>\n  <k1>0.1</k1>\n</calibration>\n',
    REFUSED,
)
add(
    "realitycapture xmp",
    '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n <rdf:RDF xmlns:rdf="x">\n <rdf:Description xcr:Version="3" xcr:DistortionModel="brown3" xcr:FocalLength35mm="24" xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#">\n',
    REFUSED,
)
add(
    "halcon",
    '# INTERNAL CAMERA PARAMETERS\n\nParGroup: Camera: Parameter;\n  "Internal camera parameters";\n\nCamera:  CamType:  "area_scan_division";\n        "";\n        "";\n',
    REFUSED,
)
add(
    "pix4d",
    "#Focal Length mm assuming a sensor width of 17.30x12.98mm\nF 15.1\n#Principal Point mm\nPX 8.6\nPY 6.4\n#Symmetrical Lens Distortion Coeffs\nK1 -0.01\nK2 0.02\nK3 0.0\n#Tangential Lens Distortion Coeffs\nT1 0.0001\nT2 0.0002\n",
    REFUSED,
)
add("nvm", "NVM_V3\n\n2\na.jpg 700 1 0 0 0 0 0 0 0.1 0\n", REFUSED)
add(
    "vicon xcp",
    '<?xml version="1.0"?>\n<Cameras>\n<Camera DEVICEID="1" SENSOR_SIZE="1280 720"><KeyFrames><KeyFrame FOCAL_LENGTH="1000" PRINCIPAL_POINT="640 360" VICON_RADIAL="0 0"/></KeyFrames></Camera></Cameras>\n',
    REFUSED,
)
add(
    "qualisys",
    '<?xml version="1.0"?>\n<calibration calibrated="2020" source="a.qca"><cameras><camera serial="1"><intrinsic focallength="12" sensorMinU="0"/></camera></cameras></calibration>\n',
    REFUSED,
)
add(
    "lensfun",
    '<!DOCTYPE lensdatabase SYSTEM "lensfun-database.dtd">\n<lensdatabase version="1"><lens><calibration><distortion model="ptlens" focal="10" a="0" b="0" c="0"/></calibration></lens></lensdatabase>\n',
    REFUSED,
)
add(
    "gazebo sdf",
    '<sdf version="1.6"><model name="cam"><link name="l"><sensor type="camera" name="c"><camera><horizontal_fov>1.047</horizontal_fov><image><width>1280</width><height>720</height></image></camera></sensor></link></model></sdf>\n',
    REFUSED,
)
add(
    "gaussian cameras",
    json.dumps(
        [
            {
                "id": 0,
                "img_name": "a",
                "width": 1280,
                "height": 720,
                "position": [0, 0, 1],
                "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
                "fy": 700.0,
                "fx": 700.0,
            }
        ]
    ),
    REFUSED,
)
add(
    "nuscenes",
    json.dumps(
        [
            {
                "token": "a",
                "sensor_token": "b",
                "translation": [0, 0, 0],
                "rotation": [1, 0, 0, 0],
                "camera_intrinsic": MATRIX,
            }
        ]
    ),
    REFUSED,
)
add(
    "matlab text",
    "cameraParams = \n\n  cameraParameters with properties:\n\n   Camera Intrinsics\n                         Intrinsics: [1x1 cameraIntrinsics]\n\n",
    REFUSED,
)
add(
    "kalibr omni",
    "cam0:\n  camera_model: omni\n  distortion_coeffs: [0.1,-0.02,0.001,-0.002]\n  distortion_model: radtan\n  intrinsics: [1.1,700.25,701.5,642.125,355.75]\n  resolution: [1280, 720]\n",
    REFUSED,
)
add(
    "kalibr eucm",
    "cam0:\n  camera_model: eucm\n  distortion_coeffs: []\n  distortion_model: none\n  intrinsics: [0.6,1.0,700.25,701.5,642.125,355.75]\n  resolution: [1280, 720]\n",
    REFUSED,
)
add(
    "dso fov",
    "0.535719308086809 0.669566858850269 0.493248545285398 0.500408664348414 0.897966326944875\n1280 1024\ncrop\n640 480\n",
    REFUSED,
)
add(
    "k4a ros",
    json.dumps(
        {
            "model": "rational_polynomial",
            "width": 1280,
            "height": 720,
            **NUMBERS,
            "k1": 0.1,
            "k2": -0.02,
            "k3": 0.003,
            "k4": 0.02,
            "k5": -0.01,
            "k6": 0.004,
            "codx": 0,
            "cody": 0,
            "p1": 0.001,
            "p2": -0.002,
            "metric_radius": 1.7,
        }
    ),
    RAT,
)
add("wrong keys only", "width: 1280\nheight: 720\nfocal: 700\n", REFUSED)
add("arkit lite", json.dumps({"width": 1280, "height": 720, "intrinsic": R9}), FLAT)
add(
    "luxonis list",
    json.dumps(
        {
            "width": 1280,
            "height": 720,
            "intrinsicMatrix": MATRIX,
            "distortionCoeff": list(LENS) + [0] * 6,
            "cameraType": 0,
        }
    ),
    RAT,
)
add(
    "cv2 dump",
    json.dumps(
        {
            "ret": 0.3,
            "mtx": MATRIX,
            "dist": [list(LENS[:5])],
            "rvecs": [[[0], [0], [0]]],
            "tvecs": [[[0], [0], [1]]],
            "size": [1280, 720],
        }
    ),
    R5,
)
add(
    "toml cam",
    "[camera]\nimage_size = [1280, 720]\nfx = 700.25\nfy = 701.5\ncx = 642.125\ncy = 355.75\ndistortion = [0.1, -0.02, 0.001, -0.002, 0.003]\n",
    R5,
)
add(
    "nested intrinsics",
    json.dumps(
        {
            "camera": {
                "name": "front",
                "resolution": {"width": 1280, "height": 720},
                "intrinsics": NUMBERS,
                "distortion": {"model": "plumb_bob", "coefficients": list(LENS[:5])},
            }
        }
    ),
    R5,
)
add(
    "intrinsics dict list",
    json.dumps(
        {
            "image_size": {"width": 1280, "height": 720},
            "intrinsics": {"focal_length": [700.25, 701.5], "principal_point": [642.125, 355.75]},
            "distortion": {"radial": [0.1, -0.02, 0.003], "tangential": [0.001, -0.002]},
        }
    ),
    R5,
)
add(
    "unity",
    json.dumps(
        {
            "focalLength": {"x": 700.25, "y": 701.5},
            "principalPoint": {"x": 642.125, "y": 355.75},
            "resolution": {"x": 1280, "y": 720},
        }
    ),
    FLAT,
)

size, lens = {"image_width": 1280, "image_height": 720}, list(LENS[:5])
add("limelight", json.dumps({"resolution": "1280x720", "camera_matrix": R9, "distortion_coefficients": lens}), R5)
add("size in words", f"image_size: 1280 x 720\nK: {MATRIX}\nD: {lens}\n", R5)
add("shape of an array", json.dumps({"shape": [720, 1280, 3], "mtx": MATRIX, "dist": [lens]}), R5)
add("apriltag camera_params", json.dumps({"camera_params": list(NUMBERS.values()), "width": 1280, "height": 720}), FLAT)
add("bouguet names", json.dumps({**size, "fc": [700.25, 701.5], "cc": [642.125, 355.75], "kc": lens}), R5)
add("lens in a model's name", json.dumps({**size, "K": MATRIX, "D": list(EYE), "model_name": "KannalaBrandt4"}), EQ)
add("lens by a function of cv2", json.dumps({**size, "K": MATRIX, "D": list(EYE), "algorithm": "cv2.fisheye"}), EQ)
add(
    "coefficients of a fisheye",
    json.dumps(
        {**size, "camera_matrix": NUMBERS, "fisheye_distortion": dict(zip(("k1", "k2", "k3", "k4"), EYE, strict=True))}
    ),
    EQ,
)
add("rectified or not", json.dumps({**size, "K": MATRIX, "D": lens, "undistorted": True}), R5)
add(
    "camodocal mei",
    "%YAML:1.0\n---\nmodel_type: MEI\nprojection_parameters:\n   gamma1: 700.25\n   u0: 642.125\n",
    REFUSED,
)
add("camodocal scaramuzza", "%YAML:1.0\n---\nmodel_type: scaramuzza\npoly_parameters:\n   p0: 1\n", REFUSED)
add("stella equirectangular", 'Camera:\n  model: "equirectangular"\n  cols: 1280\n  rows: 720\n', REFUSED)
add(
    "mrcal splined",
    "{\n  'lensmodel':  'LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=18_fov_x_deg=150',\n"
    "  'intrinsics': [ 700.25,701.5,642.125,355.75],\n  'imagersize': [ 1280, 720,],\n}\n",
    REFUSED,
)
add("kalibr results", "cam0 (/cam0/image_raw):\n    type: <class 'aslam_cv.libaslam_cv_python.X'>\n", REFUSED)
add("calib.io", '{"Calibration": {"cameras": [{"polymorphic_name": "libCalib::CameraModelOpenCV"}]}}', REFUSED)
