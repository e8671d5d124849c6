"""ROS 2 definitions as OMG IDL, laid out as rosidl writes them and rosbag2 concatenates them (encoding ros2idl)."""

_RULE = "=" * 80 + "\n"
_PARTS = {
    "builtin_interfaces/msg/Time": """// generated from rosidl_adapter/resource/msg.idl.em
// with input from builtin_interfaces/msg/Time.msg
// generated code does not contain a copyright notice


module builtin_interfaces {
  module msg {
    @verbatim (language="comment", text=
      "This message communicates ROS Time defined here:" "\\n"
      "https://design.ros2.org/articles/clock_and_time.html")
    struct Time {
      @verbatim (language="comment", text=
        "The seconds component, valid over all int32 values.")
      int32 sec;

      @verbatim (language="comment", text=
        "The nanoseconds component, valid in the range [0, 1e9), to be added to the seconds component.")
      uint32 nanosec;
    };
  };
};
""",
    "std_msgs/msg/Header": """#include "builtin_interfaces/msg/Time.idl"

module std_msgs {
  module msg {
    @verbatim (language="comment", text=
      "Two-integer timestamp that is expressed as seconds and nanoseconds.")
    struct Header {
      builtin_interfaces::msg::Time stamp;

      @verbatim (language="comment", text=
        "Transform frame with which this data is associated.")
      string frame_id;
    };
  };
};
""",
    "sensor_msgs/msg/Image": """#include "std_msgs/msg/Header.idl"

module sensor_msgs {
  module msg {
    struct Image {
      std_msgs::msg::Header header;
      uint32 height;
      uint32 width;
      string encoding;
      uint8 is_bigendian;
      uint32 step;
      sequence<uint8> data;
    };
  };
};
""",
    "sensor_msgs/msg/CompressedImage": """#include "std_msgs/msg/Header.idl"

module sensor_msgs {
  module msg {
    struct CompressedImage {
      std_msgs::msg::Header header;
      string format;
      sequence<uint8> data;
    };
  };
};
""",
    "sensor_msgs/msg/CameraInfo": """#include "std_msgs/msg/Header.idl"

module sensor_msgs {
  module msg {
    typedef double double__9[9];
    typedef double double__12[12];
    struct CameraInfo {
      std_msgs::msg::Header header;
      uint32 height;
      uint32 width;
      @verbatim (language="comment", text=
        "The distortion model used. \\"plumb_bob\\" - a simple model of radial and tangential distortion.")
      string distortion_model;
      sequence<double> d;
      double__9 k;
      double__9 r;
      double__12 p;
    };
  };
};
""",
    "geometry_msgs/msg/Vector3": """module geometry_msgs {
  module msg {
    struct Vector3 {
      double x;
      double y;
      double z;
    };
  };
};
""",
    "geometry_msgs/msg/Quaternion": """module geometry_msgs {
  module msg {
    struct Quaternion {
      @default (value=0.0)
      double x;

      @default (value=0.0)
      double y;

      @default (value=0.0)
      double z;

      @default (value=1.0)
      double w;
    };
  };
};
""",
    "geometry_msgs/msg/Transform": """#include "geometry_msgs/msg/Quaternion.idl"
#include "geometry_msgs/msg/Vector3.idl"

module geometry_msgs {
  module msg {
    struct Transform {
      geometry_msgs::msg::Vector3 translation;
      geometry_msgs::msg::Quaternion rotation;
    };
  };
};
""",
    "geometry_msgs/msg/TransformStamped": """#include "geometry_msgs/msg/Transform.idl"
#include "std_msgs/msg/Header.idl"

module geometry_msgs {
  module msg {
    struct TransformStamped {
      std_msgs::msg::Header header;
      string child_frame_id;
      geometry_msgs::msg::Transform transform;
    };
  };
};
""",
    "tf2_msgs/msg/TFMessage": """#include "geometry_msgs/msg/TransformStamped.idl"

module tf2_msgs {
  module msg {
    struct TFMessage {
      sequence<geometry_msgs::msg::TransformStamped> transforms;
    };
  };
};
""",
}
_HEADER = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
_NEEDED = {
    "sensor_msgs/msg/Image": _HEADER,
    "sensor_msgs/msg/CompressedImage": _HEADER,
    "sensor_msgs/msg/CameraInfo": _HEADER,
    "tf2_msgs/msg/TFMessage": (
        "geometry_msgs/msg/TransformStamped", "geometry_msgs/msg/Transform", "geometry_msgs/msg/Vector3",
        "geometry_msgs/msg/Quaternion", *_HEADER,
    ),
}  # fmt: skip


def definition(name: str) -> str:
    """The schema text of a message type and of all types in it."""
    return "".join(f"{_RULE}IDL: {part}\n{_PARTS[part]}" for part in (name, *_NEEDED[name]))
