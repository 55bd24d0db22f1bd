"""A cylindrical connector between two rigid bodies: mechanics, ROS 2 node, recordings.

Importing this package is light: no ROS, no compiler and no plotting until a module needs them.
"""

import pkgutil

__version__ = "0.1.0"

# The generated messages (cylconn_ros.msg) may be installed apart from this source tree: join both.
__path__ = pkgutil.extend_path(__path__, __name__)
