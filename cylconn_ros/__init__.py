"""A cylindrical connector between two rigid bodies: its mechanics, its ROS 2 node and its recordings.

Importing this package is light: no ROS, no compiler and no plotting is loaded until a module needs it.
"""

import pkgutil

__version__ = "0.1.0"

# The generated messages (cylconn_ros.msg) may be installed elsewhere than this source tree: join both.
__path__ = pkgutil.extend_path(__path__, __name__)
